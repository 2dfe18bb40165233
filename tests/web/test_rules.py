"""Kept rules on the pages: among what holds, in the log, and with their history."""

from __future__ import annotations

from tests.web.conftest import Filled
from tests.web.test_acts import do_some

RULE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"


def test_a_kept_rule_is_on_the_pages_of_elements(filled: Filled) -> None:
    kb, client = filled
    do_some(kb)
    kb.rules.save("one-place", RULE)
    kb.rules.save("one-place", RULE, on_violation="refuse")
    text = f"(:rule one-place :on-violation refuse {RULE})"
    parts = client.get("/api/state?kb=courier").json()["parts"]
    [part] = [one for one in parts if one["kind"] == "rule"]
    assert [one["text"] for one in part["elements"]] == [text]
    history = client.get("/api/fact", params={"kb": "courier", "text": text}).json()
    assert text in str(history)
    for path in ("/state", "/log", "/fact"):
        page = client.get(path, params={"kb": "courier", "text": text if path == "/fact" else ""})
        assert page.status_code == 200
        assert "one-place" in page.text
