"""Progress of a loop: reported after its items, in steps, and for parts of a longer piece of work."""

from iris_sysid.types import part_of_progress, with_progress


def reports(count, **options):
    calls = []
    expected = options.pop("expected", count)
    items = list(with_progress(range(count), lambda *call: calls.append(call), expected, **options))
    assert items == list(range(count))
    return calls


def test_every_item_is_reported():
    assert reports(3) == [(1, 3), (2, 3), (3, 3)]


def test_item_is_reported_after_the_body_of_the_loop():
    order = []
    for item in with_progress("ab", lambda done, _: order.append(done), 2):
        order.append(item)
    assert order == ["a", 1, "b", 2]


def test_steps_end_with_the_last_item():
    assert reports(7, every=3) == [(3, 7), (6, 7), (7, 7)]
    assert reports(6, every=3) == [(3, 6), (6, 6)]


def test_items_done_before_are_reported_first():
    assert reports(2, expected=5, done=3) == [(3, 5), (4, 5), (5, 5)]


def test_more_items_than_expected_raise_the_expectation():
    assert reports(3, expected=2) == [(1, 2), (2, 2), (3, 3)]


def test_unknown_number_stays_unknown():
    assert reports(2, expected=0) == [(1, 0), (2, 0)]


def test_no_items_report_nothing():
    assert reports(0) == []


def test_nobody_needs_to_listen():
    assert list(with_progress("abc", None, 3, every=2)) == ["a", "b", "c"]
    assert part_of_progress(None, 0, 2) is None


def test_parts_add_up_to_the_whole():
    calls = []
    for part in range(2):
        for _ in with_progress(range(4), part_of_progress(lambda *call: calls.append(call), part, 2), 4, every=2):
            pass
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
