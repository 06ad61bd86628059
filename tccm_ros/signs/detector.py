"""The text-first detector of door signs: reads all text of a picture, then selects the signs."""

from __future__ import annotations

from typing import Protocol

from PIL import Image

from tccm_ros.arrays import UInt8
from tccm_ros.config.signs import SignsConfig
from tccm_ros.signs.measurement import DetectedSign, RefusedText, SearchedText
from tccm_ros.signs.numbers import has_digits, normalised, person_name, room_number
from tccm_ros.signs.plates import (
    MIN_CONFIDENCE,
    OTHER_CONFIDENCE,
    ReadLine,
    lines_of_notices,
    plate_of,
    refusal,
)
from tccm_ros.signs.reading import TextLine, TextReader
from tccm_ros.signs.saliency_detector import SaliencyDetector

MAX_SCALE = 2.0
"""Maximum scale of a picture for the text finder. Chosen: further upscaling shows no new text."""


class Detector(Protocol):
    """Finds and reads door signs."""

    def search(self, pixels: UInt8) -> SearchedText:
        """Return the text of a picture, uint8 (H, W) brightness, or (H, W, 3) RGB."""


def sign_detector(settings: SignsConfig) -> Detector:
    """Return the detector selected by `signs.detector`.

    Raises
    ------
    MissingExtraError
        When the packages for reading text are not installed.
    """
    if settings.detector == "published":
        return SaliencyDetector()
    return SignDetector(settings.detector_side)


class SignDetector:
    """Detects door signs by reading all text.

    Parameters
    ----------
    side
        Shorter side of a picture during text detection, pixels.

    Raises
    ------
    MissingExtraError
        When the packages for reading text are not installed.
    """

    def __init__(self, side: int = SignsConfig().detector_side) -> None:
        self._reader, self._side = TextReader(), side

    def detect(self, pixels: UInt8) -> list[DetectedSign]:
        """Return the door signs of a picture, from left to right."""
        return self.search(pixels).signs

    def search(self, pixels: UInt8) -> SearchedText:
        """Return the door signs of a picture, and its other text with the reasons of refusal.

        Parameters
        ----------
        pixels
            uint8 (H, W) brightness, or (H, W, 3) red, green, blue.
        """
        picture = Image.fromarray(pixels).convert("RGB")
        scale = min(self._side / min(picture.size), MAX_SCALE)
        lines = self._reader.find(picture, scale, everywhere=False)
        notices = lines_of_notices(lines)
        read = self._read_lines(picture, [line for line in lines if line not in notices])
        signs: list[DetectedSign] = []
        reasons: list[tuple[ReadLine, str]] = []
        on_signs: list[ReadLine] = []
        # Numbers before names: a name may be in larger letters than the number of its plate.
        for own in sorted(read, key=lambda r: (not has_digits(r.number or ""), -r.line.height)):
            if own in on_signs:
                continue
            if own.number is None:
                reasons.append((own, _why_no_number(own)))
                continue
            plate = plate_of(own, read)
            reason = refusal(plate, read, notices)
            if reason:
                reasons.append((own, reason))
            else:
                signs.append(plate.sign())
                on_signs += [*plate.parts, *plate.others]
        refused = [RefusedText("", line.center, "a line of a notice") for line in notices]
        refused += [
            RefusedText(r.text, r.line.center, reason) for r, reason in reasons if r not in on_signs
        ]
        return SearchedText(
            sorted(signs, key=lambda sign: float(sign.pixel[0])),
            sorted(refused, key=lambda r: float(r.pixel[1])),
        )

    def _read_lines(self, picture: Image.Image, lines: list[TextLine]) -> list[ReadLine]:
        """Return the lines that have text, rotated by 180 deg if the picture is upside down."""
        read = [self._read(picture, line) for line in lines]
        if read and all(r.number is None for r in read):
            highest = max(read, key=lambda r: r.line.height)
            turned = self._read(picture, highest.line.turned(2))
            if turned.confidence > max(highest.confidence, MIN_CONFIDENCE):
                read = [self._read(picture, line.turned(2)) for line in lines]
        return [r for r in read if r.text]

    def _read(self, picture: Image.Image, line: TextLine) -> ReadLine:
        text, confidence, line = self._reader.read(picture, line)
        text = normalised(text)
        is_sure = confidence >= MIN_CONFIDENCE
        number = room_number(text) or person_name(text) if is_sure else None
        return ReadLine(line, text, confidence, number)


def _why_no_number(line: ReadLine) -> str:
    if line.confidence < OTHER_CONFIDENCE:
        return f"unsure ({line.confidence:.2f})"
    return "no number of a room, no name with a title"
