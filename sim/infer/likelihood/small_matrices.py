"""Solving many small positive definite systems inside JAX: no library call, so derivatives of any order are cheap."""

from typing import Any

import jax.numpy as jnp


def log_det_and_inverse(matrix: Any) -> tuple[Any, Any]:
    """(log of the determinant [n], inverse [n, m, m]) of positive definite matrices [n, m, m], by Gauss-Jordan."""
    size = matrix.shape[-1]
    left, right = matrix, jnp.broadcast_to(jnp.eye(size), matrix.shape)
    log_det = jnp.zeros(matrix.shape[:-2])
    for row in range(size):
        pivot = left[..., row, row]
        log_det = log_det + jnp.log(pivot)
        left_row, right_row = left[..., row, :] / pivot[..., None], right[..., row, :] / pivot[..., None]
        factor = left[..., :, row] - jnp.eye(size)[row]
        left = left - factor[..., :, None] * left_row[..., None, :]
        right = right - factor[..., :, None] * right_row[..., None, :]
    return log_det, right
