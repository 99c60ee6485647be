"""SDO client of one node: transfers repeated where frames are lost, blocks with fall-back, errors in words.

sdo.py       SdoChannel: objects are read and written, once or with repeats
turns.py     whose turn it is; a stop goes before all
transfer.py  expedited and segmented transfer       block.py  block transfer       abort.py  its codes
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from schwung.errors import InputError, SdoError
from schwung.fieldbus import eds
from schwung.fieldbus.canopen import abort, transfer
from schwung.fieldbus.canopen.abort import (
    ABORT_CODES,
    AbortedError,
    BrokenError,
    OverruledError,
    PreemptedError,
    SilenceError,
)
from schwung.fieldbus.canopen.block import BlockDownload, BlockUpload
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.turns import Outcome, Talk, Turns
from schwung.fieldbus.drive import Parameter, ParameterValue, RawValue

__all__ = ["ABORT_CODES", "Outcome", "SdoChannel", "is_absent", "went_unheard"]

_Action = Callable[[Talk], bytes]
Repeats = Literal["again", "never"]
_SILENT_TIMEOUT_S = 0.2  # for a node that did not answer last time: the way out shall be short
_PAUSE_S = 0.02  # before a repeat, and for the answers to what was repeated: what is late comes now
_BLOCK_ATTEMPTS = 2
_BLOCK_PATIENCE = 2.0  # times the time-out: a server may have a whole sub-block to get ready
_PREEMPTIONS = 100  # of one attempt; each is a stop, so that more of them are a loop


class SdoChannel:
    """Reads and writes objects of one node; may be used from several threads, and by timers of a stepped clock.

    `timeout_s` is how long an answer may take, `attempts` how often a transfer is begun where answers are lost.
    """

    def __init__(self, link: Link, node_id: int, timeout_s: float = 0.5, attempts: int = 3) -> None:
        self.node_id, self.timeout_s, self.attempts = node_id, timeout_s, attempts
        self._clock = link.clock
        self._turns = Turns(link, node_id)
        self._silent = False  # nobody answered last time: one attempt is enough until somebody does
        self.serves_blocks = True  # until the server says otherwise

    def close(self) -> None:
        """Stop listening."""
        self._turns.close()

    def read(self, parameter: Parameter) -> ParameterValue:
        """Read a parameter. Raises SdoError, and InputError when the answer does not fit the type."""
        data = self.upload(parameter, block=parameter.type == "DOMAIN")
        return ParameterValue(parameter, eds.decode(parameter, data))

    def write(
        self, value: ParameterValue, timeout_s: float | None = None, *, unheard: Repeats = "again"
    ) -> None:
        """Write a parameter. Raises SdoError, and InputError when the value does not fit the type.

        `unheard`: what is not answered is begun "again", or "never", where it would not be the same any more.
        """
        data = eds.encode(value.parameter, value.raw)
        self.download(value.parameter, data, timeout_s=timeout_s, unheard=unheard)

    def read_integer(self, index: int, subindex: int, type_name: str) -> int | None:
        """Read an integer. None: the drive has answered, and does not have the object, will not show it, or shows
        something else. Silence is not that: raises SdoError where the drive does not answer, or never in time."""
        parameter = Parameter(index, subindex, type_name)
        try:
            raw: RawValue = self.read(parameter).raw
        except InputError:
            return None
        except SdoError as error:
            if isinstance(error.__cause__, AbortedError) and error.__cause__.code not in abort.TRANSIENT:
                return None
            raise
        return raw if isinstance(raw, int) else None

    def upload(self, parameter: Parameter, block: bool = False) -> bytes:
        """Bytes of an object; by block transfer where asked for and the server can, else segmented or expedited.

        Raises SdoError and BusError.
        """
        by_block: _Action | None = (lambda talk: BlockUpload(talk).run()) if block else None
        short = (eds.byte_size(parameter.type) or 8) <= transfer.EXPEDITED_BYTES
        return self._transfer("read", parameter, lambda talk: transfer.upload(talk, short=short), by_block)

    def download(
        self,
        parameter: Parameter,
        data: bytes,
        block: bool = False,
        timeout_s: float | None = None,
        unheard: Repeats = "again",
    ) -> None:
        """Write bytes to an object; by block transfer where asked for and the server can. Domains go by segments.

        Raises SdoError and BusError; SdoError also where a stop has written the same object meanwhile, or somebody who
        interrupted this write: then it is not begun again.
        """
        segmented = parameter.type == "DOMAIN"
        by_block: _Action | None = (lambda talk: BlockDownload(talk, data).run()) if block and data else None
        self._transfer(
            "write",
            parameter,
            lambda talk: transfer.download(talk, data, segmented=segmented),
            by_block,
            timeout_s,
            unheard,
        )

    def write_once(self, parameter: Parameter, raw: int, timeout_s: float) -> Outcome:
        """Write 1 to 4 bytes now, once, for stopping: it waits for no transfer, from whichever thread or timer.

        A transfer under way is interrupted and begun anew afterwards, but for a write of the same object, which fails.
        Not confirmed is also what might have been the confirmation of that other write. Never raises.
        """
        multiplexer = _multiplexer(parameter)
        try:
            frame = transfer.expedited(multiplexer, eds.encode(parameter, raw))
            outcome = self._turns.stop(multiplexer, frame, timeout_s)
        except Exception:
            return Outcome.NOT_ANSWERED
        self._silent = self._silent and outcome is Outcome.NOT_ANSWERED
        return outcome

    def assume_silent(self) -> None:
        """The node answers nothing at all, by other evidence: ask only once, briefly, until it does."""
        self._silent = True

    def _transfer(
        self,
        verb: str,
        parameter: Parameter,
        plain: _Action,
        by_block: _Action | None,
        timeout_s: float | None = None,
        unheard: Repeats = "again",
    ) -> bytes:
        talk = Talk(self._turns, _multiplexer(parameter), writes=verb == "write")
        place = f"node {self.node_id}, {parameter.label}"
        with self._turns.underway(talk):
            try:
                data = None if by_block is None else self._try_block(talk, by_block)
                return self._repeat(talk, plain, timeout_s, unheard) if data is None else data
            except AbortedError as error:
                remedy = abort.REMEDIES.get(error.code, "")
                raise SdoError(place, f"the drive refused to {verb} it: {error}", remedy) from error
            except SilenceError as error:
                remedy = "Check power, cable, bit rate and node id."
                raise SdoError(place, f"no answer to {verb} it ({error})", remedy) from error
            except BrokenError as error:
                remedy = "Does something else talk to this node?"
                raise SdoError(
                    place, f"what was answered to {verb} it cannot be right: {error}", remedy
                ) from error
            except OverruledError as error:
                raise SdoError(
                    place,
                    "the write was given up, because a stop has written the same object meanwhile",
                    "Write it again where it is still wanted.",
                ) from error
            except PreemptedError as error:
                raise SdoError(
                    place, f"stops kept interrupting what was to {verb} it", "Try again."
                ) from error

    def _try_block(self, talk: Talk, action: _Action) -> bytes | None:
        """None where block transfer is refused or breaks, in whatever way: the plain transfer then decides."""
        for _ in range(_BLOCK_ATTEMPTS):
            if self._silent or not self.serves_blocks:
                break
            try:
                return self._attempt(talk, action, _BLOCK_PATIENCE * self.timeout_s)
            except AbortedError as error:
                if error.code == abort.COMMAND and not talk.accepted:
                    self.serves_blocks = False
            except (BrokenError, SilenceError):
                continue
        return None

    def _repeat(self, talk: Talk, action: _Action, timeout_s: float | None, unheard: Repeats) -> bytes:
        """Raises what the last attempt raises."""
        attempts = 1 if self._silent else self.attempts
        patience = timeout_s or (min(self.timeout_s, _SILENT_TIMEOUT_S) if self._silent else self.timeout_s)
        for left in reversed(range(attempts)):
            try:
                data = self._attempt(talk, action, patience)
            except AbortedError as error:
                self._silent = False
                # A server that does not know what to do with a segment has restarted, or was asked by others.
                forgotten = error.code == abort.COMMAND and talk.accepted
                if not (error.code in abort.TRANSIENT or forgotten) or not left:
                    raise
            except (SilenceError, BrokenError) as error:
                self._silent = not left and isinstance(error, SilenceError)
                if not left or unheard == "never":
                    raise
            else:
                self._silent = False
                talk.settle(_PAUSE_S)
                return data
            self._clock.sleep(_PAUSE_S)
        raise AssertionError("unreachable: attempts is at least 1")

    def _attempt(self, talk: Talk, action: _Action, timeout_s: float) -> bytes:
        """One attempt, begun anew when it was interrupted."""
        for _ in range(_PREEMPTIONS):
            self._turns.take(talk)
            talk.timeout_s = timeout_s
            try:
                if self._turns.noisy:
                    talk.drain()
                return talk.carry_out(action)
            except PreemptedError:
                continue
        raise PreemptedError


def _multiplexer(parameter: Parameter) -> bytes:
    return parameter.index.to_bytes(2, "little") + bytes([parameter.subindex])


def went_unheard(error: SdoError) -> bool:
    """True where the drive has said neither yes nor no."""
    return isinstance(error.__cause__, SilenceError | BrokenError)


def is_absent(error: SdoError) -> bool:
    """True where the drive said that the object or sub-index does not exist."""
    return getattr(error.__cause__, "code", None) in (abort.NO_OBJECT, abort.NO_SUBINDEX)
