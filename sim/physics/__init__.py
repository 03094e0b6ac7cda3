"""The paper's point-mass physics in JAX: wheels -> ball state -> trajectory -> height at the plane (float64)."""

import jax

# Heights accurate to 1e-5 m need float64; no other module sets it.
jax.config.update("jax_enable_x64", True)
