"""Row-wise vector arithmetic; numpy's own sums over an axis of three are several times slower."""

import numpy as np
from jaxtyping import Float


def dot(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Scalar product of each pair of rows."""
    return np.einsum("ij,ij->i", a, b)


def length(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Euclidean length of each row."""
    return np.sqrt(dot(vectors, vectors))


def unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Rows of length 1; rows of length 0 stay."""
    return vectors / np.maximum(length(vectors), 1e-20)[:, None]
