"""Board of a TI chip, from the words of a settings file and of its name.

A chip is sold on boards with different antennas: the IWR6843 on the ISK, the AOP and the ODS. Files
of TI's demos mostly name the chip alone (`% Platform:xWR68xx`), also those for the AOP and the ODS.
"""

import re
from pathlib import Path
from typing import Literal

from dechirp.core.findings import Finding
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device
from dechirp.recordings.settings.antenna_positions import find_device_or_none

_CHIP = re.compile(
    r"[aix]?(?:wr)?(12(?:43|xx)|14(?:43|xx)|16(?:42|xx)|18(?:43|xx)|22(?:43|xx)|29(?:44|xx)"
    r"|64(?:43|xx)|68(?:43|xx))(?:boost)?(aop|ods|isk)?(?:evm)?"
)
_BOARD_WORDS = ("aop", "ods", "isk")
_60_GHZ_BELOW_HZ = 70e9
_CHIP_OF_60_GHZ, _CHIP_OF_77_GHZ_AOP = "xwr6843", "xwr1843"
_ASSUMED_ISK = Finding(
    level="note",
    setting="radar.array",
    value="antennas of the ISK board assumed, since the settings name the chip alone",
    expected="the board, whose antenna positions determine directions",
    fix="no action needed if it is right; else --device xwr6843aop or --device xwr6843ods",
)


def choose_ti_board(
    file: Path,
    *,
    chip_name: str,
    start_frequency_hz: float,
    tx_mask: int,
    signs: tuple[int, ...] | None = None,
) -> tuple[Device | None, tuple[Finding, ...]]:
    """Choose the board of a settings file that does not describe its antennas.

    Parameters
    ----------
    file : Path
        The file, whose name may contain the board: `6843_ods_10Hz.cfg`.
    chip_name : str
        Name of the chip or of the board in the file; empty without one. A board counts before
        everything else.
    start_frequency_hz : float
        Start frequency of the chirps, which must lie in a band of the chip.
    tx_mask : int
        A bit for each transmitter in use; the board must have them.
    signs : tuple of int, optional
        Signs that the demo applies to the receivers (`compRangeBiasAndRxChanPhase`).

    Returns
    -------
    The board, None if unknown; and findings where words of the name, signs or nothing decide.
    """
    chip = find_device_or_none(chip_name)
    if chip is not None and (chip.kind() + chip_name.lower()).endswith(_BOARD_WORDS):
        return chip, ()
    by_name, is_board_named = _board_in_name(file.stem, start_frequency_hz, chip)
    by_signs = _board_with_signs(signs, chip)
    choices = [
        (by_name, f"the name {file.name} contains it"),
        (by_signs, "compRangeBiasAndRxChanPhase contains the signs of its receivers"),
    ]
    possible = [
        (board, reason)
        for board, reason in (choices if is_board_named else reversed(choices))
        if board is not None and _can_have_sent(board, start_frequency_hz, tx_mask)
    ]
    if not possible:
        is_isk_assumed = chip is not None and chip.kind() == _CHIP_OF_60_GHZ
        return chip, (_ASSUMED_ISK,) if is_isk_assumed else ()
    board, reason = possible[0]
    if len(possible) > 1 and is_board_named and possible[1][0] != board:
        other = possible[1][0].kind()
        return board, (
            _choice(
                board,
                "warning",
                f"{reason}, although the signs of the receivers"
                f" in compRangeBiasAndRxChanPhase are those of {other}",
            ),
        )
    if chip is None or board.kind() != chip.kind():
        return board, (_choice(board, "note", reason),)
    is_isk_assumed = board.kind() == _CHIP_OF_60_GHZ and not is_board_named
    return board, (_ASSUMED_ISK,) if is_isk_assumed else ()


def _choice(board: Device, level: Literal["note", "warning"], reason: str) -> Finding:
    """Return the finding that a board was chosen."""
    return Finding(
        level=level,
        setting="radar.array",
        value=f"chosen --device {board.kind()} because {reason}",
        expected="the board, whose antenna positions determine directions",
        fix="no action needed if it is right; else give the board (--device NAME)",
    )


def _board_in_name(
    stem: str, start_frequency_hz: float, chip: Device | None
) -> tuple[Device | None, bool]:
    """Return the board that the words of a name mean together, and whether they name a board.

    A word for the chip alone means its first board.
    """
    words = re.split(r"[^a-z0-9]+", stem.lower())
    matches = [match for match in map(_CHIP.fullmatch, words) if match]
    kinds = {device(match[1]).kind() for match in matches}
    boards = {match[2] for match in matches if match[2]} | {*_BOARD_WORDS}.intersection(words)
    if chip is not None:
        kinds = {chip.kind()}
    elif not kinds and boards:
        # "ods" also names obstacle detection sensors of 77 GHz: ods_aop_config.cfg.
        is_60_ghz = start_frequency_hz < _60_GHZ_BELOW_HZ
        kinds = (
            {_CHIP_OF_60_GHZ} if is_60_ghz else {_CHIP_OF_77_GHZ_AOP} if "aop" in boards else set()
        )
    if len(kinds) != 1:
        return None, False
    word = next((word for word in _BOARD_WORDS if word in boards), "")
    return find_device_or_none(kinds.pop() + (word if word != "isk" else "")), bool(word)


def _board_with_signs(signs: tuple[int, ...] | None, chip: Device | None) -> Device | None:
    """Return the only board of a chip whose receivers have such signs; None without any."""
    if not signs or -1 not in signs:
        return None
    prefix = "" if chip is None else chip.kind()
    boards = [
        board
        for board in (board_class() for board_class in Device.members().values())
        if board.kind().startswith(prefix) and board.rx_signs == signs
    ]
    return boards[0] if len(boards) == 1 else None


def _can_have_sent(board: Device, start_frequency_hz: float, tx_mask: int) -> bool:
    """Return whether a board has a band and the transmitters."""
    return tx_mask.bit_length() <= len(board.tx_m) and any(
        low <= start_frequency_hz <= high for low, high in board.limits.bands_hz
    )
