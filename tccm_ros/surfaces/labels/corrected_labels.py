"""Labels of surfaces that a user has corrected; they override those of the rules.

A correction is stored in a view, by the patch number that is the surface's id, relative to the
first patch of that view. So it refers to the same surface after a late view has shifted the ids,
after the view was removed, and in saved and merged maps.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from tccm_ros.errors import MapError
from tccm_ros.surfaces.labels.labels import Label, SurfaceLabel
from tccm_ros.surfaces.views.views import View, first_numbers


def label_to_give(text: str) -> SurfaceLabel:
    """Return a user-supplied label.

    Raises
    ------
    MapError
        If the text is no label, or the floor, which is found by its height.
    """
    wanted = [label for label in SurfaceLabel if label is not SurfaceLabel.FLOOR]
    if text not in wanted:
        raise MapError(f"no label '{text}': expected one of {', '.join(wanted)}")
    return SurfaceLabel(text)


def corrected_labels(views: Sequence[View]) -> dict[int, SurfaceLabel]:
    """Return the corrected labels by surface id.

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
    """Return views with exactly these corrections.

    Parameters
    ----------
    views
        All views, in stamp order.
    labels
        Corrected labels by surface id.

    Raises
    ------
    MapError
        If the views have no surface of an id.
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
    """Return the labels of surfaces: the corrected label if there is one, else that of the rules.

    Parameters
    ----------
    labels
        Labels of the rules. The floor is never overridden.
    ids
        For each surface, its id and its merged ids, ascending; the first id with a correction
        counts.
    corrected
        Corrected labels by surface id.
    """
    return [
        next((Label(corrected[k], 1.0) for k in own if k in corrected), label)
        if label.name is not SurfaceLabel.FLOOR
        else label
        for label, own in zip(labels, ids, strict=True)
    ]
