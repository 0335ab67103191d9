"""The page for data that can't be shown: the reason, and what is needed."""

from html import escape
from pathlib import Path

from flask import Flask

from sandbot_model.explore.loopback import own_host_only

NEEDED = (
    "A campaign folder, bags, or a trials CSV with the columns phi, omega_rad_s and speed_m_s (SI units), and at least "
    "one trial with status ok. Correct the data and start explore again."
)
RELOAD = '<meta http-equiv="refresh" content="3">'
PAGE = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">{again}<title>{title}</title><style>{style}</style></head>
<body><main class="page"><h1>{title}</h1>
<p class="message" role="alert"><strong>Nothing can be shown.</strong> {reason}</p>
<p><strong>What is needed.</strong> {needed}</p></main></body>
</html>"""


def app(title: str, reason: str, again: bool = False) -> Flask:
    """A server with one page that states ``reason``; it reloads (``again``) where trials may still arrive."""
    style = (Path(__file__).parent / "assets" / "base.css").read_text(encoding="utf-8")
    page = PAGE.format(
        title=escape(title), reason=escape(reason), needed=escape(NEEDED), style=style, again=RELOAD if again else ""
    )
    server = Flask("sandbot_explorer_no_data")
    own_host_only(server)
    server.add_url_rule("/", "page", lambda: page)
    return server
