"""The pages of the application, and addresses at which they show the story."""

from __future__ import annotations

from urllib.parse import urlencode

from tests.support.crawling import PATHS


def address(path: str, **query: object) -> str:
    """Write an address of the story's knowledge base."""
    return f"{path}?{urlencode({'kb': 'courier', **query})}"


# The id of the story's plan.
PLAN = 1
# Each page, at the addresses that show different parts of it.
ADDRESSES: dict[str, tuple[str, ...]] = {
    "/": ("/",),
    "/api": ("/api",),
    "/ask": (
        address("/ask"),
        address("/ask", condition="(robot_at ?r ?p)", at="2026-03-02 14:03"),
        address("/ask", condition="(robot_at rb1 t1)"),
        address("/ask", condition="(robot_at rb1 ?p)", mode="when"),
    ),
    "/act": (address("/act", id=f"{PLAN}.2"), address("/act", id=f"{PLAN}.3")),
    "/acts": (address("/acts"), address("/acts", outcome="failed", object="rb1", since=9)),
    "/action": (address("/action", name="move"),),
    "/corrections": (address("/corrections"), address("/corrections", since=9, until=30)),
    "/difference": (address("/difference", a=9, b=30), address("/difference")),
    "/fact": (address("/fact", text="(robot_at rb1 t1)"), address("/fact", text="(battery rb1)")),
    "/function": (address("/function", name="battery"),),
    "/given": (address("/given", id=PLAN),),
    "/log": (
        address("/log"),
        address("/log", text="guest", since="2026-03-02 09:00"),
        address("/log", element="(robot_at rb1 t1)"),
        address("/log", actor="executive", before=20),
    ),
    "/timeline": (
        address("/timeline"),
        address("/timeline", object="rb1", since="2026-03-02 14:00", until="2026-03-02 14:30"),
        address("/timeline", predicate="served", kind="goal"),
    ),
    "/merge": (address("/merge"),),
    "/object": (address("/object", name="rb1"), address("/object", name="front")),
    "/objects": (
        address("/objects"),
        address("/objects", type="robot", at="2026-03-02 14:03"),
        address("/objects", at=0),
    ),
    "/overview": (address("/overview"),),
    "/plan": (address("/plan", id=PLAN),),
    "/plans": (address("/plans"),),
    "/predicate": (address("/predicate", name="robot_at"),),
    "/revision": (address("/revision", number=36), address("/revision", number=9)),
    "/rules": (address("/rules"),),
    "/search": (address("/search", q="rb1"), address("/search", q="12")),
    "/state": (
        address("/state"),
        address("/state", at=9, object="rb1"),
        address("/state", kind="fact", text="rb"),
        address("/state", at="2026-03-02 14:03"),
    ),
    "/statistics": (address("/statistics"), address("/statistics", by="arguments", since=9)),
    "/type": (address("/type", name="table"),),
    "/verify": (address("/verify"),),
}
ALL = [each for path in PATHS for each in ADDRESSES.get(path, ())]
# Of each page one.
FIRST = [given[0] for given in ADDRESSES.values() if given]
