"""NumPy array types for annotations: one per number type, and float64 arrays of a shape.

Pydantic checks the shape when it reads a file; other shapes are given in docstrings.
"""

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, PlainValidator, WithJsonSchema

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
Int32 = NDArray[np.int32]
UInt8 = NDArray[np.uint8]
UInt16 = NDArray[np.uint16]
Bool = NDArray[np.bool_]


def array_type(*shape: int | None, is_finite: bool = True) -> tuple[PlainValidator, Any]:
    """Return the validator and JSON Schema of a float64 array; None stands for any length."""

    def check(value: Any) -> Float64:
        array = np.asarray(value, np.float64)
        if array.size == 0 and shape[0] is None:
            array = array.reshape(0, *shape[1:])
        fits = len(array.shape) == len(shape) and all(
            wanted in (None, found) for wanted, found in zip(shape, array.shape)
        )
        if not fits or (is_finite and not np.isfinite(array).all()):
            raise ValueError(f"an array of {' x '.join(str(n or 'N') for n in shape)} is expected")
        return array

    schema: dict[str, Any] = {"type": "number" if is_finite else ["number", "null"]}
    for length in reversed(shape):
        schema = {"type": "array", "items": schema}
        if length is not None:
            schema |= {"minItems": length, "maxItems": length}
    return PlainValidator(check), WithJsonSchema(schema)


Pixel = Annotated[Float64, *array_type(2)]
Vector = Annotated[Float64, *array_type(3)]
Ring = Annotated[Float64, *array_type(None, 3)]
Ring2 = Annotated[Float64, *array_type(None, 2)]
Ends = Annotated[Float64, *array_type(2, 2)]
Ends3 = Annotated[Float64, *array_type(2, 3)]
Covariance2 = Annotated[Float64, *array_type(2, 2, is_finite=False)]
PlaneErrors = Annotated[Float64, *array_type(3, is_finite=False)]
Covariance3 = Annotated[Float64, *array_type(3, 3, is_finite=False)]


def _number(missing: float) -> tuple[BeforeValidator, WithJsonSchema]:
    """Return the validator and JSON Schema of a number whose value null stands for `missing`."""
    schema = {"type": ["number", "null"]}
    return BeforeValidator(lambda v: missing if v is None else v), WithJsonSchema(schema)


KnownNumber = Annotated[float, *_number(math.nan)]
"""A number; NaN, in files null, if it is not known."""

LimitedNumber = Annotated[float, *_number(math.inf)]
"""A number; inf, in files null, without a limit."""
