"""The pages of the application, and addresses at which they show the story."""

from __future__ import annotations

from urllib.parse import urlencode

from starlette.routing import Route

from kant_sql.web.pages import TOPICS


def address(path: str, **query: object) -> str:
    """Write an address of the story's knowledge base."""
    return f"{path}?{urlencode({'kb': 'courier', **query})}"


# Each page, at the addresses that show different parts of it.
ADDRESSES: dict[str, tuple[str, ...]] = {
    "/": ("/",),
    "/revision": (address("/revision", number=36), address("/revision", number=9)),
}
PATHS = sorted(
    {
        route.path
        for pages in TOPICS
        for route in pages.html.routes
        if isinstance(route, Route) and "GET" in (route.methods or ())
    }
)
ALL = [each for path in PATHS for each in ADDRESSES.get(path, ())]
