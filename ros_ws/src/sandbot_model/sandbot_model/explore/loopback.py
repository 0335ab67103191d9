"""A page that runs formulas and reads files for whoever opens it answers this host only."""

from flask import Flask, request

HOST = "127.0.0.1"


def own_host_only(server: Flask) -> None:
    """Refuse a page of another site that had its name point here (DNS rebinding)."""

    def check() -> tuple[str, int] | None:
        host = request.host.rsplit(":", 1)[0]
        return None if host in (HOST, "localhost") else (f"this page is for this host only, not for {host}", 403)

    server.before_request(check)
