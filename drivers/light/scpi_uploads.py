"""How samples get into a function generator, and what it must be told to play them: each maker's own way.

The samples of one cycle lie in the memory of the generator, the cycle is played several times in a burst, and between
bursts the output is at the first sample. What the manuals give:

===========  ==============================  ====================  =================================  ================
dialect      samples                         levels                rate of samples                    proof
===========  ==============================  ====================  =================================  ================
Rigol        8 to 131 072 of its 8 million   14 bits, 0 to 0x3FFF  60 million a second, mode SRATE    number of points
Keysight     8 to 1 000 000                  16 bits, +-32767      125 million a second, filter off   number of points
Siglent      8 to 16 384                     16 bits, +-32767      75 million a second, mode TrueArb  every sample
===========  ==============================  ====================  =================================  ================

- Rigol takes 16 384 samples in a block; more come in several, and no more than eight of them are sent here. That is
  the DG1000Z; the DG800, DG900 and DG2000 spell the rate in another way, and refuse it with an error. The upload by
  itself makes the channel play samples, so that the mode, the burst and its trigger are told again after it.
- Keysight gives samples a name. Its filter is off, or steps would ring. That is the 33500 and 33600 series; the
  33220A has another command.
- Siglent says nothing of what came, but gives the samples back. In the other mode, DDS, it would stretch them over
  its own raster. An SDG1000X has no TrueArb and refuses it. Some models put slopes between samples where they are not
  told to hold.
- None has a trigger output that marks each edge of such a waveform: see
  :class:`~drivers.light.scpi_generator.ScpiGenerator`.

Sources: Rigol DG1000Z programming guide, chapter 2, [:TRACe]:DATA:DAC16 and :DATA:POINts, :FUNCtion:ARBitrary and
:BURSt:IDLE; Agilent 33500 series operating and service guide, DATA, FUNCtion:ARBitrary and FORMat subsystems; Siglent
SDG programming guide PG02, WVDT, ARWV and SRATE, and example 5.1.3.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from drivers.light.scpi_dialects import Keysight, Rigol, Setting, Siglent
from drivers.light.scpi_samples import Memory

if TYPE_CHECKING:
    import numpy.typing as npt

    from drivers.light.scpi_dialects import Dialect
    from drivers.light.scpi_samples import Samples

__all__ = ["NAME", "Upload", "upload_for"]

NAME: Final = "EVSBENCH"  #: of the samples in the generator
_BLOCK: Final = 16_384  #: samples
_RATE_TOLERANCE: Final = 1e-6  #: part of itself by which a rate may be rounded


class Upload(ABC):
    """Samples in the language of one maker."""

    memory: ClassVar[Memory]
    reads_back: ClassVar[bool] = False  #: whether the samples themselves can be asked for

    @abstractmethod
    def before(self) -> tuple[Setting, ...]:
        """Return what has to be set before the samples are sent."""

    @abstractmethod
    def blocks(self, code: npt.NDArray[np.int64]) -> list[tuple[str, bytes]]:
        """Return what sends the samples: a name for messages, and the bytes."""

    @abstractmethod
    def stored(self, count: int) -> Setting:
        """Return what asks how many samples have come; for one that reads back, what asks for them."""

    @abstractmethod
    def playing(self, samples: Samples) -> tuple[Setting, ...]:
        """Return what lets the samples wait for their trigger."""


class _OnTree(Upload):
    """What Rigol and Keysight have in common."""

    def __init__(self, source: str, preparation: tuple[Setting, ...]) -> None:
        self._source = source
        # The trigger of the burst and so on; not the function, nor what the output does between bursts.
        self._burst = tuple(s for s in preparation if s.what in ("burst mode", "burst trigger", "burst"))

    def _word(self, what: str, node: str, word: str, *same: str) -> Setting:
        return Setting(what, f"{self._source}{node} {word}", f"{self._source}{node}?", (word, *same))

    def _number(self, what: str, node: str, value: float, unit: str = "", tolerance: float = 0.0) -> Setting:
        head = f"{self._source}{node}"
        return Setting(what, f"{head} {value:.15g}", f"{head}?", float(value), unit, tolerance)

    def _course(self, samples: Samples) -> tuple[Setting, ...]:
        rate = samples.rate_hz
        return (
            self._number("rate of samples", "FUNC:ARB:SRAT", rate, "samples a second", _RATE_TOLERANCE * rate),
            self._number("number of cycles", "BURS:NCYC", samples.cycles),
            self._number("start phase", "BURS:PHAS", 0.0, "degrees", 0.1),
        )


class _RigolUpload(_OnTree):
    memory = Memory(fewest=8, most=8 * _BLOCK, codes=1 << 14, highest_hz=60e6)

    def before(self) -> tuple[Setting, ...]:
        """Return what has to be set before: by frequency, it would stretch the samples over its own raster."""
        return (self._word("mode of samples", "FUNC:ARB:MODE", "SRATE", "SRAT"),)

    def blocks(self, code: npt.NDArray[np.int64]) -> list[tuple[str, bytes]]:
        """Return blocks of up to 16 384 samples, each of two bytes, the lower one first."""
        head = f"{self._source}TRAC:DATA:DAC16 VOLATILE"
        parts = [code[first : first + _BLOCK] for first in range(0, len(code), _BLOCK)]
        if len(parts) > 1 and len(parts[-1]) < self.memory.fewest:  # a block has its least size
            parts[-2:] = np.array_split(np.concatenate(parts[-2:]), 2)
        named = [(f"{head},{'END' if part is parts[-1] else 'CON'}", part.astype("<u2")) for part in parts]
        return [(f"{name} ({len(part)} samples)", f"{name},".encode() + _block(part)) for name, part in named]

    def stored(self, count: int) -> Setting:
        """Return what asks how many samples have come."""
        return Setting("number of samples", "", f"{self._source}DATA:POIN? VOLATILE", float(count))

    def playing(self, samples: Samples) -> tuple[Setting, ...]:
        """Return what lets the samples wait for their trigger; they were chosen by their upload."""
        chosen = Setting("function", "", f"{self._source}FUNC?", ("USER", "ARB", "VOLATILE"))
        between = self._word("level between bursts", "BURS:IDLE", "FPT")
        return (chosen, *self._burst, *self.before(), between, *self._course(samples))


class _KeysightUpload(_OnTree):
    memory = Memory(fewest=8, most=1_000_000, codes=65_535, highest_hz=125e6)

    def before(self) -> tuple[Setting, ...]:
        """Return what has to be set before: the lower byte of a sample comes last."""
        return (Setting("order of bytes", "FORM:BORD NORM", "FORM:BORD?", ("NORM", "NORMAL")),)

    def blocks(self, code: npt.NDArray[np.int64]) -> list[tuple[str, bytes]]:
        """Return one block, after what makes room: samples of the same name would be refused."""
        head = f"{self._source}DATA:ARB:DAC {NAME}"
        clear = f"{self._source}DATA:VOL:CLE"
        return [
            (clear, clear.encode()),
            (f"{head} ({len(code)} samples)", f"{head},".encode() + _block((code - 32_767).astype(">i2"))),
        ]

    def stored(self, count: int) -> Setting:
        """Return what asks how many samples have come."""
        return Setting("number of samples", "", f"{self._source}DATA:ATTR:POIN? {NAME}", float(count))

    def playing(self, samples: Samples) -> tuple[Setting, ...]:
        """Return what lets the samples wait for their trigger."""
        return (
            self._word("samples", "FUNC:ARB", NAME, f'"{NAME}"'),
            self._word("filter", "FUNC:ARB:FILT", "OFF"),
            self._word("function", "FUNC", "ARB"),
            *self._burst,
            *self._course(samples),
        )


class _SiglentUpload(Upload):
    memory = Memory(fewest=8, most=_BLOCK, codes=65_535, highest_hz=75e6)
    reads_back = True

    def __init__(self, channel: int) -> None:
        self._head = f"C{channel}:"

    def before(self) -> tuple[Setting, ...]:
        """Return nothing: it can be sent at once."""
        return ()

    def blocks(self, code: npt.NDArray[np.int64]) -> list[tuple[str, bytes]]:
        """Return all samples in one piece, each of two bytes, the lower one first."""
        head = f"{self._head}WVDT WVNM,{NAME}"
        # Frequency, amplitude and so on are set afterwards; they are asked for here all the same.
        rest = f",TYPE,5,LENGTH,{2 * len(code)}B,FREQ,1000.0,AMPL,1.0,OFST,0.0,PHASE,0.0,WAVEDATA,"
        return [(f"{head} ({len(code)} samples)", (head + rest).encode() + (code - 32_767).astype("<i2").tobytes())]

    def stored(self, count: int) -> Setting:
        """Return what asks for the samples."""
        return Setting("samples", "", f"WVDT? USER,{NAME}", float(count))

    def playing(self, samples: Samples) -> tuple[Setting, ...]:
        """Return what lets the samples wait for their trigger; the burst before its parts, which it resets."""
        rate = samples.rate_hz
        return (
            self._set("samples", "ARWV", "NAME", NAME),
            self._set("function", "BSWV", "WVTP", "ARB"),
            self._set("mode of samples", "SRATE", "MODE", "TARB"),
            self._set("rate of samples", "SRATE", "VALUE", rate, "samples a second", _RATE_TOLERANCE * rate),
            self._set("between samples", "SRATE", "INTER", "HOLD", optional=True),
            self._set("burst", "BTWV", "STATE", "ON"),
            self._set("burst mode", "BTWV", "GATE_NCYC", "NCYC"),
            self._set("burst trigger", "BTWV", "TRSR", "MAN"),
            self._set("number of cycles", "BTWV", "TIME", float(samples.cycles)),
            self._set("start phase", "BTWV", "STPS", 0.0, "degrees", 0.1),
        )

    def _set(
        self,
        what: str,
        node: str,
        field: str,
        value: float | str,
        unit: str = "",
        tolerance: float = 0.0,
        *,
        optional: bool = False,
    ) -> Setting:
        expected = (value,) if isinstance(value, str) else value
        text = value if isinstance(value, str) else f"{value:.15g}"
        head = f"{self._head}{node}"
        return Setting(what, f"{head} {field},{text}", f"{head}?", expected, unit, tolerance, field, optional)


def upload_for(dialect: Dialect) -> Upload:
    """Return how samples get into a generator of a dialect."""
    if isinstance(dialect, Rigol):
        return _RigolUpload(dialect.source, dialect.preparation())
    if isinstance(dialect, Keysight):
        return _KeysightUpload(dialect.source, dialect.preparation())
    if isinstance(dialect, Siglent):
        return _SiglentUpload(dialect.channel)
    raise TypeError(f"no samples for {type(dialect).__name__}")


def _block(data: npt.NDArray[np.uint16] | npt.NDArray[np.int16]) -> bytes:
    """Return a block of definite length, IEEE 488.2, 7.7.6."""
    size = str(data.nbytes)
    return f"#{len(size)}{size}".encode() + data.tobytes()
