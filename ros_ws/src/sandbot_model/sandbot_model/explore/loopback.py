"""A page that runs formulas and reads files for whoever opens it answers this host only."""

from flask import Flask, request

HOST = "127.0.0.1"


def own_host_only(server: Flask) -> None:
    """Refuse a page of another site, whether its name points here (DNS rebinding) or it sends something here."""

    def check() -> tuple[str, int] | None:
        host = request.host.rsplit(":", 1)[0]
        if host not in (HOST, "localhost"):
            return f"this page is for this host only, not for {host}", 403
        if request.headers.get("Origin") not in (None, f"http://{request.host}"):
            return "only this page may ask for that", 403
        return None

    server.before_request(check)
