"""Compressed depth images: image_transport's compressedDepth, as PNG or RVL.

The data begin with a header of 12 bytes: a format code, and the coefficients A and B of the
quantisation of depths in m: ``q = A / depth + B`` (compressed_depth_image_transport). The step
grows with the square of the depth, as the noise of a structured-light camera. Depths in mm are
stored unchanged. Pillow decodes the PNG: it is a dependency of matplotlib already.
"""

from __future__ import annotations

import io
import math
import struct
from typing import Any

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float32, UInt16
from tccm_ros.errors import MessageError, one_line
from tccm_ros.kernels import kernel

_HEADER = struct.Struct("<iff")
_RVL_SIZE = struct.Struct("<ii")
_PNG_SIZE = struct.Struct(">8s4x4sII")

MAX_PIXELS = 16_000_000
"""Maximum number of pixels of an image. Chosen: four times those of a 2 k depth camera."""

NEAREST = 0.1
"""Minimum quantised depth, m: half of the codes are for depths below twice this."""


PLUGIN = "compressedDepth"
"""Name of compressed depth images in image_transport's topics and formats."""


def is_depth_format(text: str, data: Any = b"") -> bool:
    """Return whether compressed images are depth images.

    These are compressedDepth, and the 16-bit PNG that the picture plugin makes of depths in mm.

    Parameters
    ----------
    text, data
        Format and data of a sensor_msgs/CompressedImage: drivers that write PNG alone as the format
        are known by the data.
    """
    encoding, _, how = (part.strip() for part in text.partition(";"))
    return PLUGIN in how or _is_plain_png(encoding, how) or _is_16_bit_png(encoding, data)


def _is_plain_png(encoding: str, how: str) -> bool:
    return encoding == "16UC1" and "png" in how and PLUGIN not in how


def _is_16_bit_png(encoding: str, data: Any) -> bool:
    """Return whether data begin as a grey PNG image of 16 bits, which is not called a picture."""
    head = bytes(data[:26])
    return encoding != "mono16" and head[:8] == b"\x89PNG\r\n\x1a\n" and head[24:] == b"\x10\x00"


def read_compressed_depth(text: str, data: bytes) -> UInt16 | Float32:
    """Return the depths of a compressed depth image.

    Parameters
    ----------
    text
        Format of the sensor_msgs/CompressedImage, such as ``16UC1; compressedDepth png``.
    data
        Data of the message.

    Returns
    -------
    uint16 (H, W), mm, or float32 (H, W), m, with NaN for no depth.

    Raises
    ------
    MessageError
        For another format, and for truncated or inconsistent data.
    """
    encoding, _, how = (part.strip() for part in text.partition(";"))
    if _is_plain_png(encoding, how) or _is_16_bit_png(encoding, data):
        return _read_png(bytes(data))
    if PLUGIN not in how or encoding not in ("16UC1", "32FC1"):
        raise MessageError(
            f"compressed image has format '{text[:60]}', "
            "expected '16UC1; compressedDepth', '32FC1; compressedDepth' or '16UC1; png'"
        )
    if len(data) < _HEADER.size:
        raise MessageError(f"compressed depth image has {len(data)} bytes")
    _, a, b = _HEADER.unpack_from(data)
    body = bytes(data[_HEADER.size :])
    numbers = _read_rvl(body) if how.endswith("rvl") else _read_png(body)
    if encoding == "16UC1":
        return numbers
    if not (math.isfinite(a) and math.isfinite(b)) or a <= 0.0:
        raise MessageError(f"compressed depth image has depth parameters {a:g}, {b:g}")
    return _dequantise(numbers, a, b)


def _check_size(width: int, height: int) -> None:
    if width <= 0 or height <= 0 or width * height > MAX_PIXELS:
        raise MessageError(
            f"compressed depth image of {width} x {height} pixels; at most {MAX_PIXELS} are read"
        )


def _read_png(body: bytes) -> UInt16:
    """Return the values of a 16-bit PNG; its size is checked before decoding."""
    if len(body) < _PNG_SIZE.size:
        raise MessageError(f"compressed depth image has {len(body)} bytes of PNG")
    signature, chunk, width, height = _PNG_SIZE.unpack_from(body)
    if signature != b"\x89PNG\r\n\x1a\n" or chunk != b"IHDR":
        raise MessageError("compressed depth image is no PNG")
    _check_size(width, height)
    try:
        with Image.open(io.BytesIO(body), formats=["PNG"]) as image:
            if not image.mode.startswith("I"):
                raise MessageError(
                    f"compressed depth image has mode {image.mode}, expected 16 bits"
                )
            numbers = np.asarray(image)
    except MessageError:
        raise
    except Exception as error:  # Pillow raises many exceptions for damaged data
        raise MessageError(f"compressed depth image is damaged ({one_line(error)})") from None
    return np.ascontiguousarray(numbers.astype(np.uint16, copy=False))


def _read_rvl(body: bytes) -> UInt16:
    """Return the values of RVL data: run-length and variable-length coding (Wilson 2017)."""
    if len(body) < _RVL_SIZE.size:
        raise MessageError(f"compressed depth image has {len(body)} bytes of RVL")
    width, height = _RVL_SIZE.unpack_from(body)
    _check_size(width, height)
    words = np.frombuffer(body, "<u4", (len(body) - _RVL_SIZE.size) // 4, _RVL_SIZE.size)
    numbers = np.zeros(width * height, np.uint16)
    if not decode_rvl(words.astype(np.uint32), numbers):
        raise MessageError(f"compressed depth image of {width} x {height} pixels is cut")
    return numbers.reshape(height, width)


@kernel
def _next_number(words: Any, state: Any) -> Any:
    """Return the next variable-length number, -1 at the end; each nibble has three data bits.

    `state` int64 (1,) is the number of nibbles read so far.
    """
    value, shift = np.int64(0), np.int64(0)
    while shift < 33:
        k = state[0] >> 3
        if k >= len(words):
            return np.int64(-1)
        nibble = (np.int64(words[k]) >> (28 - 4 * (state[0] & 7))) & 15
        state[0] += 1
        value |= (nibble & 7) << shift
        shift += 3
        if nibble & 8 == 0:
            return value
    return np.int64(-1)


@kernel
def decode_rvl(words: Any, numbers: Any) -> bool:
    """Decode RVL data: alternating runs of zeros and of differences.

    Parameters
    ----------
    words
        uint32 (M,), nibbles from the most significant one.
    numbers
        uint16 (N,), initially zero; written.

    Returns
    -------
    bool
        Whether the data are complete.
    """
    state, k, last = np.zeros(1, np.int64), 0, np.int64(0)
    while k < len(numbers):
        zeros = _next_number(words, state)
        if zeros < 0 or zeros > len(numbers) - k:
            return False
        k += zeros
        if k == len(numbers):
            return True
        count = _next_number(words, state)
        if count < 0 or count > len(numbers) - k or count + zeros == 0:
            return False
        for _ in range(count):
            coded = _next_number(words, state)
            if coded < 0:
                return False
            last += (coded >> 1) ^ -(coded & 1)
            numbers[k] = np.uint16(last & 0xFFFF)
            k += 1
    return True


def _dequantise(numbers: UInt16, a: float, b: float) -> Float32:
    """Return depths in m, float32, NaN where the value is 0: ``depth = A / (q - B)``."""
    below = numbers.astype(np.float32) - np.float32(b)
    known = (numbers != 0) & (below > 0.0)
    return np.where(known, np.float32(a) / np.where(known, below, 1.0), np.nan).astype(np.float32)
