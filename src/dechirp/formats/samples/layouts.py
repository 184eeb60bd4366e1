"""How int16 words of TI radars stand for samples: which receiver, which part, which instant.

`TwoLanes`: a DCA1000 behind an xWR16xx, 18xx or 68xx. Chirp after chirp, in each the
receivers one after the other, in each the samples in groups of four words that hold two
complex samples, `A0 A1 B0 B1`.

`FourLanes`: a DCA1000 behind an xWR12xx or 14xx: `I1 I2 I3 I4 Q1 Q2 Q3 Q4` for each sample.

`Pairs`: a TSW1400, or an xWR14xx read by the debugger: `I1 Q1 I2 Q2 ...` for each sample.

TI application report SWRA581, Mmwave Radar Device ADC Raw Data Capture; the rest from real
recordings.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import numba
import numpy as np

from dechirp.core.values import value
from dechirp.formats.settings.base import Iq
from dechirp.radar.chirp import Chirp

N_LANES = 4
"""Of a chip that writes its receivers in turn, whether they are on or not."""


@value
class Code:
    """How a word stands for a number, and which part of a complex sample comes first."""

    bits: int = 16
    """Of the converter, in the low end of the word; whatever fills the rest."""
    offset_binary: bool = False
    """Whether the middle code stands for zero, instead of two's complement."""
    iq: Iq = "iq"

    @property
    def unused_bits(self) -> int:
        """Bits of a word above the code."""
        return 16 - self.bits

    @property
    def scale(self) -> float:
        """Size of one step, where full scale is 1."""
        return 2.0 ** (1 - self.bits)

    @property
    def flip(self) -> int:
        """Bits to turn around, of a word shifted up, that make it two's complement."""
        return -32768 if self.offset_binary else 0

    def words(self, codes: np.ndarray) -> np.ndarray:
        """Words of codes, (chirp, rx, sample) or (chirp, rx, sample, 2), int16 of the same shape.

        Of complex ones the part that comes first is first. Bits above the code repeat its sign.
        """
        words = ((codes << self.unused_bits) ^ self.flip) >> self.unused_bits
        return words[..., ::-1] if words.ndim == 4 and self.iq == "qi" else words


class Layout(ABC):
    """Order of the words of a chirp."""

    name: ClassVar[str]

    @abstractmethod
    def chirp_words(self, chirp: Chirp, n_rx: int) -> int:
        """Words that a chirp takes."""

    @abstractmethod
    def decode(self, words: np.ndarray, out: np.ndarray, code: Code) -> None:
        """Fill (chirp, rx, sample) with the words of so many chirps, at full scale 1.

        Parameters
        ----------
        words : (chirp, word) int16
            Sorted in place: read them again to use them again.
        out : (chirp, rx, sample) complex64 or float32
        code : Code
            How a word stands for a number.
        """

    @abstractmethod
    def encode(self, codes: np.ndarray, code: Code) -> np.ndarray:
        """Words of so many chirps, (chirp, word) int16, of which `decode` makes the codes again.

        Parameters
        ----------
        codes : (chirp, rx, sample) int16, or (chirp, rx, sample, 2) of complex samples
            Of the converter, both parts of a sample side by side, the in-phase part first.
        code : Code
            How a word stands for a number.
        """


@value
class TwoLanes(Layout):
    """Receivers one after the other, complex samples in groups of two."""

    name: ClassVar[str] = "two lanes, one receiver after the other"

    def chirp_words(self, chirp: Chirp, n_rx: int) -> int:
        """See `Layout.chirp_words`."""
        return n_rx * chirp.n_samples * (2 if chirp.sampling == "complex" else 1)

    def decode(self, words: np.ndarray, out: np.ndarray, code: Code) -> None:
        """See `Layout.decode`."""
        if np.iscomplexobj(out):
            sort = _from_iq if code.iq == "iq" else _from_qi
            sort(words.reshape(-1).view(np.uint64))
        rows = out.reshape(len(out), -1).view(np.float32)
        _convert(words.reshape(rows.shape), rows, code.unused_bits, code.flip)

    def encode(self, codes: np.ndarray, code: Code) -> np.ndarray:
        """See `Layout.encode`; complex samples must be even in number."""
        words = code.words(codes)
        if words.ndim == 4:
            groups = words.reshape(*words.shape[:2], -1, 2, 2)
            words = np.swapaxes(groups, -2, -1)
        return words.reshape(len(codes), -1)


@value
class FourLanes(Layout):
    """Receivers in turn, their in-phase parts before their quadrature parts."""

    name: ClassVar[str] = "four lanes, receivers in turn"
    receivers: tuple[int, ...]
    """Lanes that count, from 0 to 3; all four are always there."""
    n_present: ClassVar[int] = N_LANES

    def chirp_words(self, chirp: Chirp, n_rx: int) -> int:
        """See `Layout.chirp_words`."""
        return chirp.n_samples * N_LANES * (2 if chirp.sampling == "complex" else 1)

    def decode(self, words: np.ndarray, out: np.ndarray, code: Code) -> None:
        """See `Layout.decode`."""
        _in_turn(words, out, code, np.array(self.receivers), n_present=N_LANES, of_lanes=True)

    def encode(self, codes: np.ndarray, code: Code) -> np.ndarray:
        """See `Layout.encode`; lanes that do not count are zero."""
        turns = np.moveaxis(code.words(codes), 1, -1)
        words = np.zeros((*turns.shape[:-1], N_LANES), np.int16)
        words[..., self.receivers] = turns
        return words.reshape(len(codes), -1)


@value
class Pairs(Layout):
    """Receivers in turn, both parts of one side by side."""

    name: ClassVar[str] = "pairs of I and Q, receivers in turn"
    receivers: tuple[int, ...]
    """Places that count, of those that have room."""
    n_present: int
    """Receivers that have room."""

    def chirp_words(self, chirp: Chirp, n_rx: int) -> int:
        """See `Layout.chirp_words`."""
        return chirp.n_samples * self.n_present * (2 if chirp.sampling == "complex" else 1)

    def decode(self, words: np.ndarray, out: np.ndarray, code: Code) -> None:
        """See `Layout.decode`."""
        places = np.array(self.receivers)
        _in_turn(words, out, code, places, n_present=self.n_present, of_lanes=False)

    def encode(self, codes: np.ndarray, code: Code) -> np.ndarray:
        """See `Layout.encode`; places that do not count are zero."""
        turns = np.moveaxis(code.words(codes), 1, 2)
        words = np.zeros((*turns.shape[:2], self.n_present, *turns.shape[3:]), np.int16)
        words[:, :, self.receivers] = turns
        return words.reshape(len(codes), -1)


def _in_turn(
    words: np.ndarray,
    out: np.ndarray,
    code: Code,
    places: np.ndarray,
    *,
    n_present: int,
    of_lanes: bool,
) -> None:
    """Decode receivers that take turns sample by sample."""
    if not np.iscomplexobj(out):
        _one_part(words, out, places, n_present, code.unused_bits, code.flip)
        return
    numbers = out.view(np.float32)
    q_first = code.iq == "qi"
    sort = _lanes if of_lanes else _pairs
    sort(words.view(np.uint32), numbers, places, n_present, q_first, code.unused_bits, code.flip)


# Sorting the words as whole integers first and converting them in a second loop lets both be
# vectorised: 6 ms for 128 MiB through two lanes, where one loop over the words takes 39 ms.
# Chirp by chirp, what was sorted stays in the nearest cache.


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _convert(words: np.ndarray, out: np.ndarray, unused_bits: int, flip: int) -> None:
    """Numbers of words, in the same order."""
    scale = np.float32(1 / 32768)
    for m in range(words.shape[0]):
        for n in range(words.shape[1]):
            out[m, n] = scale * np.int16((words[m, n] << unused_bits) ^ flip)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _from_iq(groups: np.ndarray) -> None:
    """Sort words I0 I1 Q0 Q1 to I0 Q0 I1 Q1; the first of a group is its lowest."""
    outer, second, third = (
        np.uint64(0xFFFF00000000FFFF),
        np.uint64(0x00000000FFFF0000),
        np.uint64(0x0000FFFF00000000),
    )
    by = np.uint64(16)
    for n in range(groups.size):
        x = groups[n]
        groups[n] = (x & outer) | ((x >> by) & second) | ((x << by) & third)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _from_qi(groups: np.ndarray) -> None:
    """Sort words Q0 Q1 I0 I1 to I0 Q0 I1 Q1; the first of a group is its lowest."""
    first, second, third, fourth = (
        np.uint64(0x000000000000FFFF),
        np.uint64(0x00000000FFFF0000),
        np.uint64(0x0000FFFF00000000),
        np.uint64(0xFFFF000000000000),
    )
    one, two = np.uint64(16), np.uint64(32)
    for n in range(groups.size):
        x = groups[n]
        groups[n] = (
            ((x >> two) & first)
            | ((x << one) & second)
            | ((x >> one) & third)
            | ((x << two) & fourth)
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _convert_pairs(
    pairs: np.ndarray, out: np.ndarray, q_first: bool, unused_bits: int, flip: int
) -> None:
    """Numbers of pairs of words, (receiver, sample) to (receiver, sample and part)."""
    if q_first:
        by = np.uint32(16)
        for k in range(pairs.shape[0]):
            for n in range(pairs.shape[1]):
                pairs[k, n] = (pairs[k, n] >> by) | (pairs[k, n] << by)
    _convert(pairs.view(np.int16), out, unused_bits, flip)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _lanes(
    words: np.ndarray,
    out: np.ndarray,
    places: np.ndarray,
    n_present: int,
    q_first: bool,
    unused_bits: int,
    flip: int,
) -> None:
    """Decode I1 I2 I3 I4 Q1 Q2 Q3 Q4 of each sample, two words in each number."""
    lower, upper, by = np.uint32(0x0000FFFF), np.uint32(0xFFFF0000), np.uint32(16)
    n_samples = out.shape[2] // 2
    lanes = np.empty((n_present, n_samples), np.uint32)
    for m in range(words.shape[0]):
        row = words[m]
        for n in range(n_samples):
            i12, i34, q12, q34 = row[4 * n], row[4 * n + 1], row[4 * n + 2], row[4 * n + 3]
            lanes[0, n] = (i12 & lower) | (q12 << by)
            lanes[1, n] = (i12 >> by) | (q12 & upper)
            lanes[2, n] = (i34 & lower) | (q34 << by)
            lanes[3, n] = (i34 >> by) | (q34 & upper)
        _convert_pairs(lanes[places], out[m], q_first, unused_bits, flip)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _pairs(
    words: np.ndarray,
    out: np.ndarray,
    places: np.ndarray,
    n_present: int,
    q_first: bool,
    unused_bits: int,
    flip: int,
) -> None:
    """Decode I1 Q1 I2 Q2 ... of each sample, two words in each number."""
    n_samples = out.shape[2] // 2
    pairs = np.empty((places.size, n_samples), np.uint32)
    for m in range(words.shape[0]):
        turns = words[m].reshape(n_samples, n_present)
        for k in range(places.size):
            for n in range(n_samples):
                pairs[k, n] = turns[n, places[k]]
        _convert_pairs(pairs, out[m], q_first, unused_bits, flip)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _one_part(
    words: np.ndarray,
    out: np.ndarray,
    places: np.ndarray,
    n_present: int,
    unused_bits: int,
    flip: int,
) -> None:
    """Decode real samples of receivers that take turns."""
    scale = np.float32(1 / 32768)
    for m in range(words.shape[0]):
        for k in range(places.size):
            for n in range(out.shape[2]):
                word = words[m, n * n_present + places[k]]
                out[m, k, n] = scale * np.int16((word << unused_bits) ^ flip)
