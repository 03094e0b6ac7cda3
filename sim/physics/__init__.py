"""The paper's point mass in JAX: wheels -> ball state -> trajectory -> height at the plane. Double precision."""

import jax

# Heights to 1e-5 m need it; the one place in the house that says so.
jax.config.update("jax_enable_x64", True)
