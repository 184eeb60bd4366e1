"""Well-known files that are no recordings, recognised by their first bytes.

A stand-in is a small text that was stored in place of a recording: a pointer of Git LFS, git-annex
or DVC, or the error page of a web server. Test vectors of TI's mmwavelib contain windows and powers
besides samples, in layouts that only the source of each test states.

References
----------
Git LFS specification, "Pointer"; git-annex, "pointer file"; Library of Congress, Sustainability of
Digital Formats (signatures of file formats). ISO/IEC 11172-3 (MP3); ECMA-119 (ISO 9660);
TensorFlow, "TFRecord and tf.train.Example"; NIfTI-1 and NIfTI-2 headers; `onnx.proto`.
"""

import codecs
import re
import struct
import zipfile
from pathlib import Path
from typing import NamedTuple

from dechirp.core.errors import RecordingError, quote_for_message

_ISO_OFFSET = 32_769  # of the signature in the first descriptor, after 16 sectors and its type
_HEAD_BYTES = _ISO_OFFSET + 5
_TEXT_BYTES = 512
_TAR_OFFSET = 257  # of the signature in the first entry

_READ_CAN_LOG = (
    "read its objects with dechirp.object_lists.read_objects, or read_can_log with the DBC of the"
    " vendor; follow them with dechirp.object_lists.objects_to_detections and dechirp.track"
)
_READ_OBJECT_LIST = (
    "read an object list with dechirp.object_lists.read_objects, and follow its objects with"
    " dechirp.object_lists.objects_to_detections and dechirp.track"
)
_RUN_TRAFFIC = "put a radar on a vehicle: dechirp run FILE --ego ID; dechirp.open_traffic reads it"
_WRONG_FILE = "give the recording itself"
_UNPACK = "unpack it, and give the recording in it"
_SAVE_ARRAY = "save its array as .npy, .mat or .h5, and name the axes with --axes"
_TO_WAV = "give the WAV file, or convert it with a program for sound"
_TO_CSV = "save the sheet as CSV"
_COPY_AGAIN = "copy the file again from its source, and give the recording in it"
_OFFICE_MEMBER = "[Content_Types].xml"  # of documents by ECMA-376
ZIP_HEADER_BYTES = 30
"""Length of the header of a member of a ZIP archive, before its name."""


class ForeignFile(NamedTuple):
    """Kind of a file that is no recording, and the step that gives one."""

    description: str
    fix: str | None = None
    """None: a reader of this file type exists, so the file is damaged or of another layout."""
    is_stand_in: bool = False


# First bytes of file types that are not raw samples.
_SIGNATURES = {
    b"\x93NUMPY": ForeignFile("a NumPy array"),
    b"\x89HDF": ForeignFile("an HDF5 file"),
    b"MATLAB": ForeignFile("a MATLAB file"),
    b"\x89MCAP0\r\n": ForeignFile("an MCAP file"),
    b"#ROSBAG V2.0": ForeignFile("a ROS 1 bag"),
    b"\x0a\x0d\x0d\x0a": ForeignFile("a network capture (pcapng)"),
    b"\x02\x01\x04\x03\x06\x05\x08\x07": ForeignFile("detections from a TI radar's serial port"),
    **dict.fromkeys(
        (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\xa1\xb2\x3c\x4d"),
        ForeignFile("a network capture (pcap)"),
    ),
    **dict.fromkeys(
        (b"CDF\1", b"CDF\2", b"CDF\5"),
        ForeignFile(
            "a netCDF file of version 3", "convert it to netCDF 4: nccopy -k nc4 IN OUT.nc"
        ),
    ),
    b"#ROSBAG V1": ForeignFile(
        "a ROS bag of version 1", "convert it to version 2.0: rosbag migrate"
    ),
    b"SQLite format 3\0": ForeignFile(
        "an SQLite database", "give a ROS 2 bag, which has the tables topics and messages"
    ),
    b"LASF": ForeignFile("a LAS point cloud of a laser scanner", "give the radar's point cloud"),
    b"ASTM-E57": ForeignFile("an E57 point cloud of a laser scanner", "give the radar's points"),
    b"LOGG": ForeignFile("a CAN log (BLF)", _READ_CAN_LOG),
    b"MDF     ": ForeignFile("a measurement file (ASAM MDF)", _SAVE_ARRAY),
    b"TDSm": ForeignFile("a LabVIEW measurement file (TDMS)", _SAVE_ARRAY),
    b"PAR1": ForeignFile("a Parquet table", f"{_READ_OBJECT_LIST}; of samples, {_SAVE_ARRAY}"),
    b"frame,time_s,number,status,x_m,": ForeignFile("an object list (CSV)", _READ_OBJECT_LIST),
    **dict.fromkeys((b"ARROW1", b"FEA1"), ForeignFile("an Arrow table", _SAVE_ARRAY)),
    b"PK\x03\x04": ForeignFile("a ZIP archive", _UNPACK),
    b"PK\x05\x06": ForeignFile("an empty ZIP archive", _UNPACK),
    b"\x1f\x8b\x08": ForeignFile("a gzip archive", "unpack it: gunzip FILE"),
    b"\xfd7zXZ\0": ForeignFile("an xz archive", "unpack it: unxz FILE"),
    b"\x28\xb5\x2f\xfd": ForeignFile("a Zstandard archive", "unpack it: unzstd FILE"),
    b"\x04\x22\x4d\x18": ForeignFile("an LZ4 archive", "unpack it: unlz4 FILE"),
    b"7z\xbc\xaf\x27\x1c": ForeignFile("a 7-Zip archive", _UNPACK),
    b"Rar!\x1a\x07": ForeignFile("a RAR archive", _UNPACK),
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": ForeignFile("a Microsoft Office document", _TO_CSV),
    b"%PDF": ForeignFile("a PDF document", _WRONG_FILE),
    b"{\\rtf": ForeignFile("a text document (RTF)", _WRONG_FILE),
    b"\x89PNG": ForeignFile("a PNG picture", _WRONG_FILE),
    b"\xff\xd8\xff": ForeignFile("a JPEG picture", _WRONG_FILE),
    **dict.fromkeys((b"GIF87a", b"GIF89a"), ForeignFile("a GIF picture", _WRONG_FILE)),
    **dict.fromkeys((b"II*\0", b"MM\0*"), ForeignFile("a TIFF picture", _WRONG_FILE)),
    b"\x1a\x45\xdf\xa3": ForeignFile("a Matroska or WebM video", _WRONG_FILE),
    b"fLaC": ForeignFile("a FLAC sound file", _TO_WAV),
    b"OggS": ForeignFile("an Ogg sound file", _TO_WAV),
    b"ID3": ForeignFile("an MP3 sound file", _TO_WAV),
    b"FORM": ForeignFile("an AIFF sound file", _TO_WAV),
    b"\x7fELF": ForeignFile("a program (ELF)", _WRONG_FILE),
    **dict.fromkeys(
        (b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe"),
        ForeignFile("a program (Mach-O or Java)", _WRONG_FILE),
    ),
    b"\0asm": ForeignFile("a program (WebAssembly)", _WRONG_FILE),
    b"8BPS": ForeignFile("a Photoshop picture", _WRONG_FILE),
    b"\x0e\x03\x13\x01": ForeignFile("an HDF4 file", "convert it to HDF5: h4toh5 IN OUT.h5"),
    b"SIMPLE  = ": ForeignFile("a FITS file", _SAVE_ARRAY),
    b"Obj\1": ForeignFile("an Avro table", _SAVE_ARRAY),
    b"\0\1\0\0Standard ": ForeignFile("an Access database", _TO_CSV),
}

# Signatures that need more evidence than their first bytes.
_PATTERNS = {
    rb"RIFF....WAVE|RF64....WAVE": ForeignFile("a WAV file"),
    rb"RIFF....AVI ": ForeignFile("an AVI video", _WRONG_FILE),
    rb"RIFF....WEBP": ForeignFile("a WebP picture", _WRONG_FILE),
    rb"RIFF": ForeignFile("a RIFF file, neither WAV nor AVI", _WRONG_FILE),
    rb"....ftyp": ForeignFile("an MP4 or QuickTime video", _WRONG_FILE),
    rb"BZh[1-9]1AY&SY": ForeignFile("a bzip2 archive", "unpack it: bunzip2 FILE"),
    rb"BM....\0\0\0\0": ForeignFile("a BMP picture", _WRONG_FILE),
    rb"MZ.{58}..\0\0": ForeignFile("a Windows program", _WRONG_FILE),
    rb"\x80[\2-\5][\x95}\]()cq]": ForeignFile(
        "a Python pickle, which dechirp does not load because it can run programs",
        "load it in Python where you trust it, and save its array with numpy.save",
    ),
    rb"ply\r?\nformat ": ForeignFile(
        "a PLY point cloud",
        f"{_READ_OBJECT_LIST}; convert other clouds to PCD, which dechirp inspect reads",
    ),
    rb"date [^\n]+\r?\nbase (?:hex|dec) ": ForeignFile("a CAN log (ASC)", _READ_CAN_LOG),
    rb"\(\d+\.\d+\) \w+ [0-9A-Fa-f]{3,8}#": ForeignFile("a CAN log (candump)", _READ_CAN_LOG),
    rb'(?:\xef\xbb\xbf)?\s*VERSION\s+"': ForeignFile(
        "a CAN database (DBC), which describes messages",
        "give the recording itself; dechirp.object_lists.read_objects reads CAN logs",
    ),
    # A length, and a message that begins with its version, 3 or higher.
    rb"....\n[\2-\x0c]\x08[\3-\5]\x10": ForeignFile(
        "a trace of ASAM OSI messages",
        "read object lists with dechirp.object_lists.read_objects, and true traffic with"
        " dechirp.open_traffic",
    ),
    rb"(?:\xef\xbb\xbf)?\s*(?i:<!doctype html|<html|<head)": ForeignFile(
        "a web page (HTML), such as the error or login page of a server, in place of the file",
        "download the file itself: the link to the raw file, with a login where it is needed",
        is_stand_in=True,
    ),
    rb"(?:\xef\xbb\xbf)?\s*<\?xml.{0,300}<Error>": ForeignFile(
        "the error message of a server (XML) in place of the file",
        "download the file again, with a login where it is needed",
        is_stand_in=True,
    ),
    **dict.fromkeys(
        (
            rb"(?:\xef\xbb\xbf)?\s*(?:<\?xml[^>]*>\s*)?(?:<!--.{0,400}?-->\s*)?<commonRoad\b",
            # The columns of trajectory-csv, and of highD, inD, NGSIM, SUMO and INTERACTION.
            rb"(?:\xef\xbb\xbf)?(?i:(?=[^\n]*\bid\b)(?=[^\n]*\bclass\b)[^\n]*\bheading\b)",
            rb"(?i:frame,id,x,y,width,height,xvelocity|recordingid,trackid,|vehicle_id,frame_id,)",
            rb"(?i:timestep_time;|(?:case_id,)?track_id,frame_id,timestamp_ms,)",
        ),
        ForeignFile("true traffic, such as CommonRoad or trajectories (CSV)", _RUN_TRAFFIC),
    ),
    rb"(?:\xef\xbb\xbf)?\s*<(?:\?xml|svg)": ForeignFile("an XML document", _WRONG_FILE),
    rb"(?:\.\./|\.git)*/annex/objects/": ForeignFile(
        "a pointer of git-annex, not the file itself",
        "fetch the file: git annex get FILE, or datalad get FILE",
        is_stand_in=True,
    ),
    rb".{128}DICM": ForeignFile("a medical picture (DICOM)", _WRONG_FILE),
    # The size of the header, 348 or 540 bytes in either byte order, and the version.
    **dict.fromkeys(
        (
            rb"(?:\x5c\x01\0\0|\0\0\x01\x5c).{340}n[i+]1\0",
            rb"(?:\x1c\x02\0\0|\0\0\x02\x1c)n[i+]2\0",
        ),
        ForeignFile("a medical picture (NIfTI)", _WRONG_FILE),
    ),
    rb"\d{1,6}\s+\d{1,6}\s+NUM=\d+\s": ForeignFile(
        "test data of TI's group tracker, points and reference tracks without samples",
        _WRONG_FILE,
    ),
    rb"(?:\xff\x7f){128,132}(?:\0\x80\0\0|\0\0\xff\x7f){15}": ForeignFile(
        "test vectors of TI's mmwavelib, windows and twiddle factors before the samples",
        "give the recording itself; of test vectors, save the samples as .npy",
    ),
    rb"outs:\s+- (?:md5|hash|etag):": ForeignFile(
        "a pointer of DVC, not the file itself", "fetch the file: dvc pull FILE", is_stand_in=True
    ),
}
_LFS_POINTER = re.compile(
    rb"version https?://(?:git-lfs\.github\.com|hawser\.github\.com)/spec/"
    rb"(?:.*\nsize (\d{1,18})\s*$)?",
    re.DOTALL,
)
_COMPILED = {re.compile(pattern, re.DOTALL): kind for pattern, kind in _PATTERNS.items()}


def read_head(path: Path) -> bytes:
    """Return the first bytes of a file, as many as its kind needs."""
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)


def identify_foreign_file(head: bytes) -> ForeignFile | None:
    """Return the kind of a file with these first bytes; None if it may be raw samples or text."""
    pointer = _LFS_POINTER.match(head)
    if pointer:
        size = f" of {int(pointer[1])} bytes" if pointer[1] else ""
        return ForeignFile(
            f"a pointer of Git LFS to a file{size}, not the file itself",
            "fetch the file: git lfs install, then git lfs pull; or download it from the page of"
            " its repository",
            is_stand_in=True,
        )
    for pattern, kind in _COMPILED.items():
        if pattern.match(head):
            return kind
    for magic, kind in _SIGNATURES.items():
        if head.startswith(magic):
            return kind
    return _identify_by_structure(head)


def _identify_by_structure(head: bytes) -> ForeignFile | None:
    """Return the kind of a file without a signature at its start; None if it may be another."""
    for has_structure, kind in _STRUCTURES.items():
        if has_structure(head):
            return kind
    return None


def _is_tar(head: bytes) -> bool:
    return head[_TAR_OFFSET : _TAR_OFFSET + 5] == b"ustar"


def _is_disc_image(head: bytes) -> bool:
    return head[_ISO_OFFSET : _ISO_OFFSET + 5] == b"CD001"


def _is_utf_16(head: bytes) -> bool:
    text = head[:_TEXT_BYTES]
    return text[:2] == b"\xff\xfe" and text[3::2].count(0) == len(text) // 2 - 1 > 3


def _is_mp3_sound(head: bytes) -> bool:
    """Return whether a file begins with three frames of MPEG sound, layer III, without a tag.

    One header, such as FF FB, is an ordinary int16 sample; the length that it states leads to
    the next one (ISO/IEC 11172-3, 2.4.2.3, and 13818-3 for half the sample rates).
    """
    start = 0
    for _ in range(3):
        length = _mpeg_frame_bytes(head[start : start + 4])
        if length is None:
            return False
        start += length
    return True


_MPEG1_KBPS = (32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320)
_MPEG2_KBPS = (8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160)
_MPEG1_RATES_HZ = (44_100, 48_000, 32_000)


def _mpeg_frame_bytes(header: bytes) -> int | None:
    """Return the length of a frame of layer III by its header; None if these bytes are none."""
    if len(header) < 4 or header[0] != 0xFF or header[1] & 0xE6 != 0xE2:
        return None
    version = header[1] >> 3 & 3  # 3: MPEG 1, 2: MPEG 2, 0: 2.5
    bit_rate, rate = header[2] >> 4, header[2] >> 2 & 3
    if version == 1 or bit_rate in (0, 15) or rate == 3:
        return None
    kbps = (_MPEG1_KBPS if version == 3 else _MPEG2_KBPS)[bit_rate - 1]
    rate_hz = _MPEG1_RATES_HZ[rate] // {3: 1, 2: 2, 0: 4}[version]
    return (144 if version == 3 else 72) * kbps * 1000 // rate_hz + (header[2] >> 1 & 1)


def _is_tf_record(head: bytes) -> bool:
    """Return whether a file begins with a length (uint64) and its masked CRC-32C, as TFRecord."""
    if len(head) < 12:
        return False
    crc = 0xFFFFFFFF
    for byte in head[:8]:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x82F63B78 * (crc & 1)
    crc ^= 0xFFFFFFFF
    masked = ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF
    return masked == int.from_bytes(head[8:12], "little")


def _is_onnx_model(head: bytes) -> bool:
    """Return whether a file begins with the version and the producer of an ONNX model.

    Fields 1 and 2 of `ModelProto` in `onnx.proto`; a model without a producer is not recognised.
    """
    if len(head) < 5 or head[0] != 0x08 or not 1 <= head[1] <= 32 or head[2] != 0x12:
        return False
    end = 4 + head[3]
    producer, next_field = head[4:end], head[end : end + 1]
    is_name = len(producer) > 2 and all(0x20 <= letter < 0x7F for letter in producer)
    return is_name and next_field in {b"\x1a", b"\x22", b"\x28", b"\x32", b"\x3a", b"\x42"}


def _is_mmwavelib_vectors(head: bytes) -> bool:
    """Return whether a file begins with a number of sizes, each twice the one before (uint32)."""
    n_sizes = int.from_bytes(head[:4], "little")
    if not 4 <= n_sizes <= 16 or len(head) < 4 * (n_sizes + 1):
        return False
    sizes = struct.unpack_from(f"<{n_sizes}I", head, 4)
    return sizes[0] > 0 and all(size == sizes[0] << n for n, size in enumerate(sizes))


_STRUCTURES = {
    _is_tar: ForeignFile("a tar archive", "unpack it: tar -xf FILE"),
    _is_disc_image: ForeignFile(
        "an image of a disc (ISO 9660)", "mount it, and give the recording in it"
    ),
    _is_mp3_sound: ForeignFile("an MP3 sound file", _TO_WAV),
    _is_tf_record: ForeignFile("a file of TensorFlow (TFRecord)", _SAVE_ARRAY),
    _is_onnx_model: ForeignFile("a neural network (ONNX)", _WRONG_FILE),
    _is_mmwavelib_vectors: ForeignFile(
        "test vectors of TI's mmwavelib, several lengths in turn", _WRONG_FILE
    ),
    _is_utf_16: ForeignFile("text in UTF-16", "save it as UTF-8"),
}


def is_text(head: bytes) -> bool:
    """Return whether the first bytes of a file are text in UTF-8.

    int16 samples of a silent input are mostly bytes 0 and 255; text has neither.
    """
    try:
        text = codecs.getincrementaldecoder("utf-8-sig")().decode(head[:_TEXT_BYTES])
    except UnicodeDecodeError:
        return False
    return bool(text) and all(letter in "\t\n\r\f" or letter >= " " for letter in text)


def examine_zip_archive(path: Path, kind: ForeignFile) -> ForeignFile:
    """Return the kind of a ZIP archive by the names of its members; other kinds unchanged."""
    if not kind.description.endswith("ZIP archive"):
        return kind
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        is_document = read_first_member_name(path) == _OFFICE_MEMBER
        description = "a document of an office program" if is_document else kind.description
        return ForeignFile(f"{description}, damaged or cut short", _COPY_AGAIN)
    if _OFFICE_MEMBER in names:
        return ForeignFile("a document of an office program", f"{_TO_CSV}, or {_WRONG_FILE}")
    if any(name.endswith("data.pkl") for name in names):
        return ForeignFile("a file of PyTorch", _SAVE_ARRAY)
    shown = ", ".join(quote_for_message(name) for name in names[:4])
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ForeignFile(f"{kind.description} with {shown or 'no files'}{more}", kind.fix)


def read_first_member_name(path: Path) -> str:
    """Return the name of the first member of a ZIP archive, which a file cut short still has."""
    with path.open("rb") as file:
        header = file.read(ZIP_HEADER_BYTES)
        name_bytes = int.from_bytes(header[26:28], "little")
        return file.read(name_bytes).decode("utf-8", "replace")


def stand_in_error(path: Path) -> RecordingError | None:
    """Return the error of a file that only stands in for a recording; None for other files."""
    if path.is_symlink() and not path.exists():
        if "annex/objects" not in path.readlink().as_posix():
            return None
        kind = identify_foreign_file(b"/annex/objects/")
    else:
        kind = identify_foreign_file(read_head(path)) if path.is_file() else None
    if kind is None or not kind.is_stand_in:
        return None
    return RecordingError(
        path, value=kind.description, expected="the recording itself", fix=str(kind.fix)
    )
