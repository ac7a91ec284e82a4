"""The validation of plans goes on where it was stopped, and counts what happened beside what was predicted."""

import json
from dataclasses import asdict

from validation.plans import WAYS, Outcome, ambiguous, calibration, table


def outcome(seed: int, way: str, power: float, right: bool) -> Outcome:
    return Outcome(seed, "pendulum", "quadratic drag", way, "long", 2, True, power, right, right, False, False)


def test_seeds_of_the_file_are_not_scored_again(tmp_path):
    rows = tmp_path / "rows.jsonl"
    made = {7: [], 8: [outcome(8, way, 0.95, True) for way in WAYS], 9: [outcome(9, way, 0.15, False) for way in WAYS]}
    lines = [json.dumps({"seed": seed, "outcomes": list(map(asdict, each))}) for seed, each in made.items()]
    rows.write_text("\n".join(lines) + "\n")
    read = ambiguous(7, 2, 1, jointly=False, rows=rows)
    assert read == [*made[8], *made[9]]
    assert table(read)["right single name"][0] == "50 % (1 of 2)"
    happened = calibration(read).set_index("predicted power")["happened"]
    assert happened["90 to 100 %"] == "100 % (3 of 3)"
    assert happened["10 to 20 %"] == "0 % (0 of 3)"
