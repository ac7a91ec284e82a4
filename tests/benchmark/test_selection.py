"""Selection is scored from the predictions, class by class."""

import pytest

from iris_sysid.benchmark.sources.selection import read_predictions
from iris_sysid.errors import DataError
from tests._project import recording
from validation.audit.selection import rescored_selection, score_selection

CLASSES = ["dropped_ball", "free_fall", "led", "pendulum", "sliding_block", "torricelli"]


@pytest.fixture(scope="module")
def scores():
    selections, gaps = rescored_selection(recording("iris_published"))
    assert gaps == []
    return {(score.dataset, score.method): score for score in selections}


@pytest.mark.parametrize(
    ("dataset", "method", "correct", "n"),
    [
        ("delfys75", "cnn", 90, 90),
        ("delfys75", "vlm-temporal", 66, 90),
        ("delfys75", "vlm-describe", 55, 90),
        ("iris", "cnn", 240, 240),
        ("iris", "vlm-temporal", 156, 240),
        ("iris", "vlm-describe", 175, 240),
    ],
)
def test_published_predictions_give_their_accuracy(scores, dataset, method, correct, n):
    score = scores[dataset, method]
    assert (score.correct, score.n, score.relabelled) == (correct, n, 0)
    assert score.interval[0] < score.accuracy <= score.interval[1] + 1e-12


def test_confusion_matrix_of_the_temporal_strategy_is_the_printed_one(scores):
    printed = [
        [10, 5, 0, 0, 0, 0],
        [0, 0, 0, 10, 5, 0],
        [0, 0, 15, 0, 0, 0],
        [2, 2, 0, 11, 0, 0],
        [0, 0, 0, 0, 15, 0],
        [0, 0, 0, 0, 0, 15],
    ]
    confusion = scores["delfys75", "vlm-temporal"].confusion
    assert confusion.loc[CLASSES, CLASSES].to_numpy().tolist() == printed


def test_both_strategies_fail_on_the_falling_ball(scores):
    right = {method: scores["iris", method].per_class["correct"] for method in ("vlm-temporal", "vlm-describe")}
    assert (right["vlm-temporal"]["dropping_ball"], right["vlm-temporal"]["falling_ball"]) == (0, 0)
    assert (right["vlm-describe"]["dropping_ball"], right["vlm-describe"]["falling_ball"]) == (20, 1)


def test_answer_outside_the_classes_counts_as_wrong_in_a_column_of_its_own():
    score = score_selection(["a", "a", "b"], ["a", "c", ""], dataset="d", method="m")
    assert list(score.confusion.columns) == ["a", "b", "c", "no answer"]
    assert (score.correct, score.n) == (1, 3)
    assert score.per_class["accuracy"].tolist() == [0.5, 0.0]


def test_wilson_interval_agrees_with_the_closed_form():
    score = score_selection(["a"] * 10, ["a"] * 8 + ["b"] * 2, dataset="d", method="m")
    assert score.interval == pytest.approx((0.49016, 0.94331), abs=1e-4)


@pytest.mark.parametrize(("truth", "answers"), [([], []), (["a"], []), ([""], ["a"])])
def test_videos_without_a_class_are_refused(truth, answers):
    with pytest.raises(DataError, match="each video needs one"):
        score_selection(truth, answers, dataset="d", method="m")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("path,gt\nx,a\n", "no column pred"),
        ("path,gt,pred,correct\nx,a\n", "line 2 has 2 fields"),
        ("path,gt,pred,correct\nx,a,a,True\nx,a,a,True\n", "names x twice"),
        ("path,gt,pred,correct\n", "1 lines"),
    ],
)
def test_damaged_prediction_file_is_refused(tmp_path, text, message):
    path = tmp_path / "predictions.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=message):
        read_predictions(path)


def test_flag_that_disagrees_is_counted(tmp_path):
    folder = tmp_path / "vlm_eval_iris"
    folder.mkdir()
    text = "path,gt_iris,pred_raw,pred_iris,comparable,correct\nx,a,a,a,True,False\ny,a,b,b,True,False\n"
    (folder / "vlm_iris_results.csv").write_text(text, encoding="utf-8")
    scores, gaps = rescored_selection(tmp_path)
    assert scores[0].relabelled == 1
    assert len(gaps) == 5
    assert all("cannot be re-scored" in gap for gap in gaps)
