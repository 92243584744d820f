"""Tables of a diagnosis: what was weighed for each cause, and what would show."""

import re

from test_report_diagnosis import edited


def weighed(page):
    """Headings of the table of candidates, and the causes below each."""
    body = page.split("Evidence: which causes were weighed")[1].split("</section>")[0]
    groups = re.findall(r"<tbody><tr><th.*?>(.*?)</th>(.*?)</tbody>", body)
    return {head: re.findall(r"<tr.*?><td>(.*?) at ", rows) for head, rows in groups}


def test_the_best_few_of_every_cause_are_shown(tmp_path):
    causes = [
        {"cause": name, "where": ["all"], "parameters": {}, "probability": 0.9}
        for name in ("coulomb_friction", "command_delay")
    ]

    def row(name, gain, step):
        return {"cause": name, "where": ["servo"], "log_evidence": gain, "step": step,
                "probability": 0.9 if step < 3 else None}  # fmt: skip

    rows = [row("coulomb_friction", 60.0, 1)]
    rows += [row(f"rival_{k}", 50.0 - k, 1) for k in range(24)]
    rows += [row("command_delay", 20.0, 2), row("first_order_lag", 30.0, 2)]
    rows += [row("payload", 2.0, 3)]
    page = edited(tmp_path, causes=causes, candidates=rows)
    found = weighed(page)
    assert list(found) == [
        "Cause 1", "Cause 2", "Weighed besides, not named"
    ]  # fmt: skip
    first, second, last = found.values()
    assert first == ["coulomb friction", "rival 0", "rival 1", "rival 2", "rival 3"]
    assert second == ["command delay", "first order lag"] and last == ["payload"]
    assert page.count("<td>named</td>") == 2 and "20 weaker candidates" in page
    assert "explains more, but leaves too much" in page
    assert "3 less is 4.5 times less likely" in page


def test_smallest_effects_say_where_the_search_ends(tmp_path):
    text = edited(tmp_path).split("What these logs could have shown")[1]
    rows = re.findall(r"<tr>(.*?)</tr>", text.split("</section>")[0])
    assert "command delay" in rows[2]
    assert ["the smallest that is looked for" in row for row in rows] == [
        False, False, True, False, False, False,
    ]  # fmt: skip
    assert "<small>torque</small></td><td>0.11 N m</td><td>servo</td>" in rows[1]
