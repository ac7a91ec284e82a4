"""The review as a widget of a notebook: the page's own module, with messages to the kernel instead of a server."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import anywidget
import traitlets

from iris_sysid.errors import DataError
from iris_sysid.review.app import asset, markup, session_app
from iris_sysid.review.in_process import answer
from iris_sysid.review.session import Session
from iris_sysid.types import Run, Track

FIT_PATIENCE_S = 600.0
THREADS = 4  # a frame, an edit and the wait for a fit at once


def _text(name: str) -> str:
    return asset(name).decode()


class ReviewWidget(anywidget.AnyWidget):  # type: ignore[misc]
    """A review in a notebook; what is edited in it is in the log of its folder at once, as on the page.

    Attributes
    ----------
    session
        What is reviewed.
    """

    _esm = _text("widget.js")
    _module = traitlets.Unicode().tag(sync=True)
    _style = traitlets.Unicode().tag(sync=True)
    _markup = traitlets.Unicode().tag(sync=True)

    def __init__(self, session: Session) -> None:
        super().__init__(_module=_text("review.js"), _style=_text("review.css"), _markup=markup(session.clip.name))
        self.session = session
        self._app = session_app(session)
        self._threads = ThreadPoolExecutor(THREADS, "review-widget")
        self.on_msg(self._received)

    @property
    def tracks(self) -> tuple[Track, ...]:
        """The tracks after the edits."""
        return self.session.state.tracks

    @property
    def run(self) -> Run:
        """The run of the tracks as edited, once its fit is done; DataError says why there is none."""
        outcome = self.session.fits.outcome(self.session.version, FIT_PATIENCE_S, whole=True)
        if outcome is None:
            raise DataError("nothing is fitted yet: wait for the tracker, or place points of the body")
        if outcome.run is None:
            raise DataError(outcome.problem or "nothing is fitted: choose the phenomenon of the clip (Phenomenon)")
        return outcome.run

    def close(self) -> None:
        """End the widget and the threads of its session; the log keeps every edit."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self.session.close()
        super().close()

    def _received(self, widget: object, content: Mapping[str, Any], buffers: object) -> None:
        """A request of a view; threads answer it, so that the kernel stays free."""
        self._threads.submit(self._answer, content)

    def _answer(self, content: Mapping[str, Any]) -> None:
        given = asyncio.run(answer(self._app, str(content.get("path", "")), content.get("content")))
        self.send({"id": content.get("id"), "status": given.status, "type": given.media_type}, [given.body])
