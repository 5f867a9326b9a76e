"""Rows of a study on the workers of a Dask scheduler, wherever these are."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from typing import Any, ParamSpec, TypeVar

from cacc_platoon import __version__
from cacc_platoon.errors import UserError

PATIENCE = 60.0
"""So long a scheduler that is started again is waited for [s]."""
_ANSWER, _FAREWELL = 5.0, 2.0
"""How long it may take to answer, and to be left [s]."""
_UNKNOWN = 16
"""Workers that are taken to come where there are none yet."""

Given = ParamSpec("Given")
Result = TypeVar("Result")


class DaskExecutor(Executor):
    """An executor of `concurrent.futures` on the workers of a scheduler.

    Parameters
    ----------
    address : str
        Of the scheduler, such as tcp://10.0.0.1:8786.

    Attributes
    ----------
    losses : tuple of exception
        What a row ends with that was lost with its worker.
    workers : int
        Rows that are evaluated at once.

    Raises
    ------
    UserError
        Where no scheduler answers, or a worker has another version of this software.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker  # noqa: PLC0415  (an extra, slow)
        except ModuleNotFoundError as error:
            raise UserError(
                "--scheduler takes Dask, which is not installed. pip install "
                "'cacc_platoon[cluster]'."
            ) from error
        for name in ("distributed", "distributed.client", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # lost connections are expected
        self.losses: tuple[type[Exception], ...] = (KilledWorker,)
        self._client = _connected(Client, address)
        self._executor: Executor = self._client.get_executor(pure=False)
        others = {v for v in self._client.run(_version).values() if v != __version__}
        if others:
            self.shutdown()
            raise UserError(
                f"{address}: a worker has cacc_platoon {min(others)}, this is {__version__}, and "
                "rows could differ. Install one version everywhere."
            )
        self.workers = sum(self._client.ncores().values()) or _UNKNOWN

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Hand a call to a worker.

        Raises
        ------
        BrokenExecutor
            When the scheduler is gone.
        """
        if self._client.status != "running":
            raise BrokenExecutor("the scheduler is gone")
        return self._executor.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the scheduler; what was not evaluated is dropped there."""
        with suppress(Exception):  # of whatever kind it is, there is nobody left to be told
            self._client.close(_FAREWELL)


def _connected(connect: Callable[..., Any], address: str) -> Any:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return connect(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            if isinstance(error, ValueError) or time.monotonic() > deadline:
                raise UserError(
                    f"--scheduler {address}: no scheduler answers there. Start `dask scheduler`, "
                    "and give the address that it prints."
                ) from error
            time.sleep(0.5)


def _version() -> str:
    return __version__
