"""Restricts the page, which evaluates formulas and reads files, to requests from this host."""

from flask import Flask, request

HOST = "127.0.0.1"


def own_host_only(server: Flask) -> None:
    """Refuse requests from other sites: by a foreign host name (DNS rebinding) or by a foreign origin."""

    def check() -> tuple[str, int] | None:
        host = request.host.rsplit(":", 1)[0]
        if host not in (HOST, "localhost"):
            return f"this page is for this host only, not for {host}", 403
        if request.headers.get("Origin") not in (None, f"http://{request.host}"):
            return "only this page may ask for that", 403
        return None

    server.before_request(check)
