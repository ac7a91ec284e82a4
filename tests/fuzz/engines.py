"""Two ways to look for input that breaks a reader: hypothesis, and coverage-guided by atheris where it is installed."""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

Edit = tuple[int, int, bytes, int]  # position, bytes removed there, what is put there, how often
EXAMPLES = 200  # of one round: hypothesis stops by their number, not by the clock
MAX_BYTES = 1 << 16  # of an input of atheris
# packages and modules whose lines guide atheris; the others stay as they are, since numba cannot compile changed ones
GUIDED = ("iris_sysid.cli", "iris_sysid.io", "iris_sysid.units", "iris_sysid.video", "fitters.own_model")
PACKAGES = ("iris_sysid", "fitters")


def mutated(data: bytes, edits: Sequence[Edit]) -> bytes:
    """The data with each edit applied in turn; positions count from either end, beyond which they are the end."""
    for position, removed, put, times in edits:
        at = min(max(position + len(data) * (position < 0), 0), len(data))
        data = data[:at] + put * times + data[at + removed :]
    return data


def edits_of(words: Sequence[bytes], longest: int) -> st.SearchStrategy[list[Edit]]:
    """A few edits of data of that length: bytes, words, cuts, and pieces a thousand times over."""
    put = st.one_of(st.sampled_from(list(words)), st.binary(max_size=4))
    times = st.one_of(st.just(1), st.just(1), st.sampled_from((0, 2, 50, 5000)))
    removed = st.one_of(st.integers(0, 4), st.integers(0, 4), st.integers(0, longest))
    return st.lists(st.tuples(st.integers(-longest, longest), removed, put, times), min_size=1, max_size=5)


def fuzz_by_hypothesis(name: str, seconds: float) -> int:
    """Give mutated input to a target for so long; the number of inputs. Raises what the target raises."""
    from tests.fuzz.corpus import corpus_of, words_of
    from tests.fuzz.targets import FUZZ_TARGETS

    corpus, target, inputs = corpus_of(name), FUZZ_TARGETS[name], 0
    for data in corpus:
        target(data)
    longest = max(map(len, corpus))
    end = time.monotonic() + seconds
    for number in count():

        @seed(number)
        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate],
        )
        @given(st.sampled_from(corpus), edits_of(words_of(name), longest))
        def round_of_inputs(data: bytes, edits: list[Edit]) -> None:
            nonlocal inputs
            if time.monotonic() < end:
                inputs += 1
                target(mutated(data, edits))

        round_of_inputs()
        if time.monotonic() >= end:
            return inputs
    return inputs


def has_atheris() -> bool:
    """Whether the coverage-guided engine is installed."""
    return importlib.util.find_spec("atheris") is not None


def unguided_modules() -> Iterator[str]:
    """Names of the modules of the packages that are not watched."""
    root = Path(__file__).parents[2]
    for path in (path for package in PACKAGES for path in (root / package).rglob("*.py")):
        name = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        if not f"{name}.".startswith(tuple(f"{guided}." for guided in GUIDED)):
            yield name


def fuzz_by_atheris(name: str, seconds: float, kept: Path) -> None:
    """Give input to a target for so long, guided by the lines that it reaches; ends the process.

    What breaks the target is left in the folder ``kept``.
    """
    import atheris

    with atheris.instrument_imports(include=list(PACKAGES), exclude=list(unguided_modules())):
        from tests.fuzz.corpus import corpus_of, words_of
        from tests.fuzz.targets import FUZZ_TARGETS
    with tempfile.TemporaryDirectory(prefix="iris-fuzz-corpus-") as folder:
        for number, data in enumerate(corpus_of(name)):
            Path(folder, f"seed-{number}").write_bytes(data)
        words = Path(folder, "words")
        words.write_text(
            "\n".join('"' + "".join(f"\\x{byte:02x}" for byte in word) + '"' for word in words_of(name) if word)
        )
        kept.mkdir(parents=True, exist_ok=True)
        limits = [f"-max_total_time={seconds:.0f}", f"-max_len={MAX_BYTES}", "-timeout=30", "-rss_limit_mb=4000"]
        atheris.Setup(
            [sys.argv[0], *limits, f"-dict={words}", f"-artifact_prefix={kept}/{name}-", folder], FUZZ_TARGETS[name]
        )
        atheris.Fuzz()
