"""OpenEXR files of scan lines: reading of uncompressed, RLE and ZIP files, writing of ZIP files.

Pictures are arrays `[height][width]`, row 0 on top. Windows are `(x0, y0, x1, y1)` with inclusive ends, as in the file.
"""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .errors import ExportError

Window = tuple[int, int, int, int]

MAGIC = 20000630
VERSION = 2
# Bits of the version field.
TILED, LONG_NAMES, DEEP, MULTI_PART = 0x200, 0x400, 0x800, 0x1000
# The sample types by their number in the file.
DTYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
NONE, RLE, ZIPS, ZIP = 0, 1, 2, 3
# Scan lines in a chunk, by the compression that can be read.
LINES = {NONE: 1, RLE: 1, ZIPS: 1, ZIP: 16}
COMPRESSIONS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
# Level of deflate: higher levels take several times as long for a few per cent.
DEFLATE_LEVEL = 4
# Longest name of a file without the LONG_NAMES bit.
SHORT_NAME = 31


@dataclass(frozen=True)
class Raw:
    """An attribute as the bytes of the file, with the name of its type."""

    type: str
    data: bytes


Attribute = str | int | float | tuple[float, float] | Raw


@dataclass
class Part:
    """One part of a file: its channels by their full name, and the attributes of its header."""

    name: str
    data_window: Window
    display_window: Window
    attributes: dict[str, Attribute]
    channels: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass
class _Layout:
    """How the chunks of a part are stored."""

    compression: int
    # Names and sample types, in the order of the file.
    channels: list[tuple[str, np.dtype]]
    offsets: tuple[int, ...] = ()


def size(window: Window) -> tuple[int, int]:
    """Width and height of a window, in pixels."""
    return window[2] - window[0] + 1, window[3] - window[1] + 1


# Reading


def read(path: str | os.PathLike[str]) -> list[Part]:
    """The parts of the file at `path`.

    Raises `ExportError` for files that are damaged, tiled, deep, or compressed in a way that is not read.
    """
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise ExportError(f"the file cannot be read: {error.strerror}", where=str(path)) from error
    try:
        return _parse(data)
    except ExportError as error:
        raise ExportError(str(error).removeprefix("error: "), where=str(path)) from error
    except (struct.error, zlib.error, ValueError, IndexError, KeyError, UnicodeDecodeError) as error:
        raise ExportError(
            "the OpenEXR file is damaged or truncated", where=str(path), found=str(error), help="render it again"
        ) from error


def _parse(data: bytes) -> list[Part]:
    magic, version = struct.unpack_from("<II", data)
    if magic != MAGIC:
        raise ExportError("this is not an OpenEXR file")
    if version & (TILED | DEEP):
        raise ExportError("tiled and deep OpenEXR files are not read here", help="save it as scan lines")
    headers, at = _headers(data, 8, bool(version & MULTI_PART))
    parts = [_part(header) for header in headers]
    layouts = [_layout(header) for header in headers]
    for part, layout in zip(parts, layouts, strict=True):
        chunks = -(-size(part.data_window)[1] // LINES[layout.compression])
        layout.offsets = struct.unpack_from(f"<{chunks}Q", data, at)
        at += 8 * chunks
    for part, layout in zip(parts, layouts, strict=True):
        _read_channels(data, part, layout, bool(version & MULTI_PART))
    return parts


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text that ends with a zero byte, and where the next item starts."""
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _headers(data: bytes, at: int, is_multi_part: bool) -> tuple[list[dict[str, Raw]], int]:
    """The headers' attributes, and where the offset tables start."""
    headers = []
    while True:
        header: dict[str, Raw] = {}
        while data[at] != 0:
            name, at = _text(data, at)
            kind, at = _text(data, at)
            (length,) = struct.unpack_from("<i", data, at)
            header[name] = Raw(kind, data[at + 4 : at + 4 + length])
            at += 4 + length
        at += 1
        if header:
            headers.append(header)
        if not header or not is_multi_part:
            return headers, at


def _part(header: dict[str, Raw]) -> Part:
    attributes = {name: _value(raw) for name, raw in header.items()}
    windows = (struct.unpack("<4i", header[name].data) for name in ("dataWindow", "displayWindow"))
    data_window, display_window = windows
    name = attributes.get("name", "")
    return Part(name if isinstance(name, str) else "", data_window, display_window, attributes)


def _value(raw: Raw) -> Attribute:
    """An attribute of a known type as a Python value."""
    match raw.type:
        case "string":
            return raw.data.decode(errors="replace")
        case "int":
            return struct.unpack("<i", raw.data)[0]
        case "float":
            return struct.unpack("<f", raw.data)[0]
        case "double":
            return struct.unpack("<d", raw.data)[0]
        case "v2f":
            return struct.unpack("<2f", raw.data)
    return raw


def _layout(header: dict[str, Raw]) -> _Layout:
    compression = header["compression"].data[0]
    if compression not in LINES:
        known = compression < len(COMPRESSIONS)
        found = COMPRESSIONS[compression] if known else f"compression {compression}"
        raise ExportError("this compression is not read here", found=found, wanted="none, RLE, ZIPS or ZIP")
    data, at, channels = header["channels"].data, 0, []
    while data[at] != 0:
        name, at = _text(data, at)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<iiii", data, at)
        if (x_sampling, y_sampling) != (1, 1):
            raise ExportError(f"channel {name} is subsampled", wanted="one sample a pixel")
        channels.append((name, DTYPES[kind]))
        at += 16
    return _Layout(compression, channels)


def _read_channels(data: bytes, part: Part, layout: _Layout, is_multi_part: bool) -> None:
    width, height = size(part.data_window)
    part.channels = {name: np.empty((height, width), dtype) for name, dtype in layout.channels}
    row_bytes = width * sum(dtype.itemsize for _, dtype in layout.channels)
    for at in layout.offsets:
        at += 4 if is_multi_part else 0
        y, length = struct.unpack_from("<ii", data, at)
        y -= part.data_window[1]
        rows = min(LINES[layout.compression], height - y)
        chunk = _unpacked(data[at + 8 : at + 8 + length], row_bytes * rows, layout.compression)
        lines = np.frombuffer(chunk, np.uint8).reshape(rows, row_bytes)
        start = 0
        for name, dtype in layout.channels:
            end = start + width * dtype.itemsize
            part.channels[name][y : y + rows] = np.ascontiguousarray(lines[:, start:end]).view(dtype)
            start = end


def _unpacked(chunk: bytes, length: int, compression: int) -> bytes:
    """The `length` bytes of a chunk. A chunk that does not get shorter is stored as it is."""
    if compression == NONE or len(chunk) == length:
        return chunk
    packed = _run_lengths(chunk) if compression == RLE else zlib.decompress(chunk)
    return _from_differences(packed)


def _run_lengths(chunk: bytes) -> bytes:
    out, at = bytearray(), 0
    while at < len(chunk):
        (count,) = struct.unpack_from("b", chunk, at)
        if count < 0:
            out += chunk[at + 1 : at + 1 - count]
            at += 1 - count
        else:
            out += chunk[at + 1 : at + 2] * (count + 1)
            at += 2
    return bytes(out)


def _from_differences(packed: bytes) -> bytes:
    """Undoes `_to_differences`."""
    values = np.frombuffer(packed, np.uint8).copy()
    values[1:] -= np.uint8(128)
    halves = np.cumsum(values, dtype=np.uint8)
    out = np.empty_like(halves)
    middle = (len(out) + 1) // 2
    out[0::2], out[1::2] = halves[:middle], halves[middle:]
    return out.tobytes()


# Writing


def write(
    path: str | os.PathLike[str],
    channels: Mapping[str, np.ndarray],
    data_window: Window,
    display_window: Window,
    attributes: Mapping[str, Attribute],
) -> None:
    """Writes `channels`, arrays `[height][width]` of half, float or 32-bit unsigned samples, as ZIP scan lines.

    The file appears complete or not at all. Raises `ExportError` if it cannot be written.
    """
    names = sorted(channels)
    width, height = size(data_window)
    for name in names:
        found, dtype = channels[name].shape, channels[name].dtype
        if found != (height, width) or dtype not in DTYPES.values():
            raise ExportError(
                f"channel {name} cannot be written",
                found=f"{found} of {dtype}",
                wanted=f"{(height, width)} of float16, float32 or uint32",
            )
    header = _header({name: channels[name].dtype for name in names}, data_window, display_window, attributes)
    chunks = []
    for y in range(0, height, LINES[ZIP]):
        rows = [np.ascontiguousarray(channels[name][y : y + LINES[ZIP]]).view(np.uint8) for name in names]
        chunks.append(_chunk(y + data_window[1], np.concatenate(rows, axis=1).reshape(-1)))
    starts = len(header) + 8 * len(chunks) + np.cumsum([0, *(len(chunk) for chunk in chunks[:-1])])
    write_bytes(path, [header, starts.astype("<u8").tobytes(), *chunks])


def write_bytes(path: str | os.PathLike[str], pieces: list[bytes]) -> None:
    """Writes a file in one step: beside it first, then renamed. Makes its folder."""
    folder, name = os.path.split(os.path.abspath(path))
    temporary = None
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{name}.", suffix=".part", delete=False) as file:
            temporary = file.name
            file.writelines(pieces)
        # A temporary file is its owner's alone; a new file has the rights that the user's mask leaves.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except OSError as error:
        raise ExportError(f"the file cannot be written: {error.strerror}", where=str(path)) from error
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.remove(temporary)


def _chunk(y: int, raw: np.ndarray) -> bytes:
    packed = zlib.compress(_to_differences(raw), DEFLATE_LEVEL)
    data = packed if len(packed) < len(raw) else raw.tobytes()
    return struct.pack("<ii", y, len(data)) + data


def _to_differences(raw: np.ndarray) -> bytes:
    """The even bytes, then the odd ones, each as the difference from the one before it plus 128."""
    halves = np.concatenate([raw[0::2], raw[1::2]])
    out = halves.copy()
    out[1:] = halves[1:] - halves[:-1] + np.uint8(128)
    return out.tobytes()


def _header(
    dtypes: Mapping[str, np.dtype], data_window: Window, display_window: Window, attributes: Mapping[str, Attribute]
) -> bytes:
    numbers = {dtype: number for number, dtype in DTYPES.items()}
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iiii", numbers[dtype], 0, 1, 1) for name, dtype in dtypes.items()
    )
    header = {
        "channels": Raw("chlist", listed + b"\0"),
        "compression": Raw("compression", bytes([ZIP])),
        "dataWindow": Raw("box2i", struct.pack("<4i", *data_window)),
        "displayWindow": Raw("box2i", struct.pack("<4i", *display_window)),
        "lineOrder": Raw("lineOrder", b"\0"),
        "pixelAspectRatio": _raw(1.0),
        "screenWindowCenter": _raw((0.0, 0.0)),
        "screenWindowWidth": _raw(1.0),
    }
    header |= {name: _raw(value) for name, value in attributes.items()}
    longest = max(len(name.encode()) for name in [*dtypes, *header])
    out = [struct.pack("<II", MAGIC, VERSION | (LONG_NAMES if longest > SHORT_NAME else 0))]
    for name, raw in header.items():
        out += [name.encode(), b"\0", raw.type.encode(), b"\0", struct.pack("<i", len(raw.data)), raw.data]
    return b"".join([*out, b"\0"])


def _raw(value: Attribute) -> Raw:
    match value:
        case Raw():
            return value
        case str():
            return Raw("string", value.encode())
        case int() | np.integer():
            return Raw("int", struct.pack("<i", value))
        case float() | np.floating():
            return Raw("float", struct.pack("<f", value))
        case (x, y):
            return Raw("v2f", struct.pack("<2f", x, y))
    raise ExportError(f"a header has no attributes of type {type(value).__name__}")


def is_complete(path: str | os.PathLike[str]) -> bool:
    """Whether there is a file at `path` that starts as an OpenEXR file does. What `write` makes is complete then."""
    try:
        with open(path, "rb") as file:
            return file.read(4) == struct.pack("<I", MAGIC)
    except OSError:
        return False
