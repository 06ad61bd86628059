"""Labels of surfaces that a person has corrected: they stay where rules would say otherwise.

A correction is kept in a view, by the number that a surface's id comes from, counted from the first
patch of that view. So it means the same surface when a late view shifts the ids, when the view is
removed, in saved maps and in maps that are merged.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from tccm_ros.errors import MapError
from tccm_ros.surfaces.labels import Label, SurfaceLabel
from tccm_ros.surfaces.views import View, first_numbers

CERTAIN = 1.0
"""Confidence of a label that a person gave."""


def label_to_give(text: str) -> SurfaceLabel:
    """Return the label that a person may give a surface.

    Raises
    ------
    MapError
        For what is no label, and for the floor, which is found by its height.
    """
    wanted = [label for label in SurfaceLabel if label is not SurfaceLabel.FLOOR]
    if text not in wanted:
        raise MapError(f"no label '{text}': expected one of {', '.join(wanted)}")
    return SurfaceLabel(text)


def corrected_labels(views: Sequence[View]) -> dict[int, SurfaceLabel]:
    """Return the labels that were corrected, by surface id.

    Parameters
    ----------
    views
        All views, in stamp order.
    """
    return {
        first + number: SurfaceLabel(label)
        for first, view in zip(first_numbers(views), views)
        for number, label in view.corrected_labels.items()
    }


def with_corrected_labels(views: Sequence[View], labels: Mapping[int, SurfaceLabel]) -> list[View]:
    """Return views with these corrections, and no others.

    Parameters
    ----------
    views
        All views, in stamp order.
    labels
        By surface id.

    Raises
    ------
    MapError
        For a surface that these views do not have.
    """
    corrected: list[View] = []
    left = dict(labels)
    for first, view in zip(first_numbers(views), views):
        own = {
            number - first: left.pop(number).value
            for number in sorted(left)
            if first - view.forgotten <= number < first + len(view.patches)
        }
        corrected.append(replace(view, corrected_labels=own))
    if left:
        raise MapError(f"no surface {min(left)} in this map: its label cannot be corrected")
    return corrected


def with_corrections(
    labels: Iterable[Label],
    ids: Iterable[Sequence[int]],
    corrected: Mapping[int, SurfaceLabel],
) -> list[Label]:
    """Return the labels of surfaces: those that a person gave, else those of the rules.

    Parameters
    ----------
    labels
        Of the rules. The floor stays the floor.
    ids
        Of each surface, its id and those that were merged into it, ascending: the first of them
        that was corrected counts.
    corrected
        By surface id.
    """
    return [
        next((Label(corrected[k], CERTAIN) for k in own if k in corrected), label)
        if label.name is not SurfaceLabel.FLOOR
        else label
        for label, own in zip(labels, ids, strict=True)
    ]
