"""A function of arrays that keeps its answers is asked once of the same arrays, and anew of others."""

import numpy as np

from fitters import kept_answers
from fitters.kept_answers import keeping_answers


def test_an_array_of_the_same_numbers_has_the_same_answer_and_a_changed_one_its_own():
    asked = []

    @keeping_answers
    def total(values, factor):
        asked.append(factor)
        return factor * float(np.sum(values))

    values = np.arange(4.0)
    assert total(values, 2.0) == total(values.copy(), 2.0) == 12.0
    assert len(asked) == 1
    values[0] = 1.0
    assert total(values, 2.0) == 14.0
    assert total(values.reshape(2, 2), 3.0) == 21.0
    assert total(values, factor=5.0) == 35.0
    assert total(values, factor=6.0) == 42.0
    assert len(asked) == 5


def test_only_the_last_answers_are_kept(monkeypatch):
    monkeypatch.setattr(kept_answers, "KEPT", 2)
    asked = []
    same = keeping_answers(lambda number: asked.append(number) or number + 1)
    assert [same(number) for number in (0, 1, 0, 2, 0, 1)] == [1, 2, 1, 3, 1, 2]
    assert asked == [0, 1, 2, 1]
