"""Integration of a rate function with pushes added to it, and the slopes of single steps.

A push is amplitude x table(value) x other value, added to one rate or, as a force is, to one input. The table is read
between its knots, so that all pushes share compiled code. States come first in every array: x [S, ...], inputs and
conditions u [U, ...].
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from truearc.errors import InputError
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.systems.system import Effect, SystemSpec

SLOPE = 1e-5                          # share of a number's size by which it is moved for a difference
MOST_SUBSTEPS = 64
CLOSE = 0.02                          # noise, or thousandths of the range, within which halved steps agree


class Pushes(NamedTuple):
    """A pushes: knots and tables [A, G]; which value each reads, which multiplies it, what it is added to [A].

    Values are states, inputs, conditions, then 1. It is added to a rate, numbered as its state, or to an input.
    """

    knots: Float[Array, "A G"]
    table: Float[Array, "A G"]
    reads: Int[Array, " A"]
    times: Int[Array, " A"]
    rate: Int[Array, " A"]


NO_PUSHES = Pushes(*(np.zeros((0, 1)),) * 2, *(np.zeros(0, dtype=int),) * 3)


def call_rate(system: SystemSpec, names: Sequence[str], x: Any, u: Any, p: Any) -> list[Any]:
    """Return the derivatives, one per state.

    Raises:
        InputError: the function returns another number of values.
    """
    assert system.rate is not None
    found = system.rate(tuple(x[k] for k in range(len(system.state))), dict(zip(names, u, strict=True)),
                        system.parameters(list(p)))
    count = len(found) if hasattr(found, "__len__") else 1
    if count != len(system.state):
        raise InputError(f"rate: returned {count} value{'s' * (count != 1)}; expected {len(system.state)}, one per "
                         f"state ({', '.join(system.state)})")
    return list(found) if hasattr(found, "__len__") else [found]


@dataclass(frozen=True, eq=False)
class Stepper:
    """Steps of a system with A pushes and with effects of the user's own. One vector z holds what slopes are taken by:
    x [S], p [P], a constant push on each rate [S], amplitudes [A], own amplitudes [E], inputs at both ends [2 U]."""

    system: SystemSpec
    names: tuple[str, ...]
    moving: int                       # number of names that are inputs; the others are conditions
    substeps: int
    own: tuple[Effect, ...]

    def rates(self, xp: Any, x: Any, u: Any, p: Any, push: Any, amps: Any, own: Any, pushes: Any) -> Any:
        added = self._added(xp, x, u, amps, pushes)
        found = call_rate(self.system, self.names, x, [one + added[len(x) + k] for k, one in enumerate(u)], p)
        size = [xp.asarray(one) + push[k] + added[k] for k, one in enumerate(found)]
        for k, effect in enumerate(self.own):
            more = effect.push(tuple(x), dict(zip(self.names, u, strict=True)), own[k])
            more = list(more) if hasattr(more, "__len__") else [more]
            if len(more) != len(size):
                raise InputError(f"effect {effect.name}: returned {len(more)} values; expected {len(size)}, one per "
                                 "state")
            size = [one + other for one, other in zip(size, more, strict=True)]
        return xp.stack([xp.broadcast_to(one, xp.shape(x)[1:]) for one in size])

    def _added(self, xp: Any, x: Any, u: Any, amps: Any, pushes: Any) -> Any:
        """What pushes add to each rate, then to each input and condition."""
        if xp is np:
            values, added = [*x, *u, 1.0], [0.0] * (len(x) + len(u))
            for k, (knots, table, reads, times, rate) in enumerate(zip(*pushes, strict=True)):
                added[rate] = added[rate] + amps[k] * values[times] * np.interp(values[reads], knots, table)
            return added
        import jax
        values = xp.concatenate([xp.asarray(x), xp.stack(list(u)) if len(u) else xp.zeros(0), xp.ones(1)])
        drawn = jax.vmap(xp.interp)(values[pushes.reads], pushes.knots, pushes.table) * values[pushes.times]
        return xp.zeros(len(values) - 1).at[pushes.rate].add(amps * drawn)

    def step(self, xp: Any, z: Any, fixed: Any, h: Any, pushes: Any) -> Any:
        """Return x one time step h later; fixed: conditions."""
        s, p, a, e = len(self.system.state), len(self.system.believed), len(pushes.rate), len(self.own)
        x, params, push, amps, own, first, last = (
            z[at:at + size] for at, size in zip(np.cumsum([0, s, p, s, a, e, self.moving]).tolist(),
                                                (s, p, s, a, e, self.moving, self.moving), strict=True))
        part = h / self.substeps

        def rates(x: Any, share: Any) -> Any:
            held = first + share * (last - first) if self.system.hold == "linear" else first
            u = [*held, *fixed]
            return self.rates(xp, x, u, params, push, amps, own, pushes)

        def one(k: Any, x: Any) -> Any:
            begin, middle, end = (k / self.substeps, (k + 0.5) / self.substeps, (k + 1.0) / self.substeps)
            k1 = rates(x, begin)
            k2 = rates(x + 0.5 * part * k1, middle)
            k3 = rates(x + 0.5 * part * k2, middle)
            k4 = rates(x + part * k3, end)
            return x + part / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

        if xp is not np:
            import jax
            return jax.lax.fori_loop(0, self.substeps, one, x)
        for k in range(self.substeps):
            x = one(k, x)
        return x

    def path(self, x0: Float[Array, "R S"], z: Float[Array, "R steps Z"], fixed: Float[Array, "R C"],
             h: Float[Array, "R steps"], pushes: Pushes) -> Float[Array, "R T S"]:
        """Return the states at all samples; z without its first S numbers."""
        if is_traced(self.system):
            return np.asarray(self._jitted(("path", len(pushes.rate)), self._scan)(x0, z, fixed, h, pushes))
        found, x = [x0.T], x0.T
        with np.errstate(all="ignore"):
            for n in range(z.shape[1]):
                x = self._numpy(np.concatenate([x, z[:, n].T]), fixed.T, h[:, n], pushes)
                found.append(x)
        return np.stack(found).transpose(2, 0, 1)

    def slopes(self, z: Float[Array, "N Z"], fixed: Float[Array, "N C"], h: Float[Array, " N"],
               pushes: Pushes) -> Float[Array, "N S Z"]:
        """Return the slopes of single steps."""
        if is_traced(self.system):
            return np.asarray(self._jitted(("slopes", len(pushes.rate)), self._jacobian)(z, fixed, h, pushes))
        found = np.zeros((len(z), len(self.system.state), z.shape[1]))
        scale = SLOPE * np.maximum(np.sqrt(np.nanmean(z**2, axis=0)), 1e-3)
        with np.errstate(all="ignore"):
            for k, size in enumerate(scale):
                ends = []
                for sign in (1.0, -1.0):
                    moved = z.T.copy()
                    moved[k] += sign * size
                    ends.append(self._numpy(moved, fixed.T, h, pushes))
                found[:, :, k] = ((ends[0] - ends[1]) / (2.0 * size)).T
        return found

    def _numpy(self, z: Float[Array, "Z N"], fixed: Float[Array, "C N"], h: Float[Array, " N"],
               pushes: Pushes) -> Float[Array, "S N"]:
        """One step of N lanes at once; lane by lane where the user's code takes no arrays."""
        compiled = self.system.compiled
        if compiled.get("lanes", True):
            try:
                return np.asarray(self.step(np, z, fixed, h, pushes), dtype=float)
            except InputError:
                raise
            except (TypeError, ValueError):
                compiled["lanes"] = False
        return np.stack([np.asarray(self.step(np, z[:, k], fixed[:, k], h[k], pushes), dtype=float)
                         for k in range(z.shape[1])], axis=1)

    def _jitted(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        whole = (*key, self.names, self.moving, self.substeps, tuple(id(one) for one in self.own))
        if whole not in self.system.compiled:
            self.system.compiled[whole] = make()
        return self.system.compiled[whole]

    def _scan(self) -> Any:
        import jax
        import jax.numpy as jnp

        def path(x0: Any, z: Any, fixed: Any, h: Any, pushes: Any) -> Any:
            def move(x: Any, at: Any) -> Any:
                there = self.step(jnp, jnp.concatenate([x, at[0]]), fixed, at[1], pushes)
                return there, there

            return jnp.concatenate([x0[None], jax.lax.scan(move, x0, (z, h))[1]])
        return jax.jit(jax.vmap(path, (0, 0, 0, 0, None)))

    def _jacobian(self) -> Any:
        import jax
        import jax.numpy as jnp
        return jax.jit(jax.vmap(jax.jacfwd(lambda z, fixed, h, pushes: self.step(jnp, z, fixed, h, pushes)),
                                (0, 0, 0, None)))


def carry(phi: Float[Array, "R steps S S"], force: Float[Array, "R steps S K"],
          begin: Float[Array, "R S K"]) -> Float[Array, "R T S K"]:
    """Return the slopes of states at all samples: d_{n+1} = phi_n d_n + force_n, from d_0 = begin."""
    found = np.empty((len(phi), phi.shape[1] + 1, *begin.shape[1:]))
    found[:, 0] = d = begin
    for n in range(phi.shape[1]):
        d = phi[:, n] @ d + force[:, n]
        found[:, n + 1] = d
    return found


def is_traced(system: SystemSpec) -> bool:
    """Return whether JAX can trace the rate function; otherwise it is differenced."""
    if system.rate is None:
        return False
    if "traced" not in system.compiled:
        import jax
        try:
            names = system.compiled["names"]
            jax.eval_shape(lambda x, u, p: call_rate(system, names, x, u, p), *(
                jax.ShapeDtypeStruct((count,), float) for count in (len(system.state), len(names),
                                                                    len(system.believed))))
            system.compiled["traced"] = True
        except InputError:
            raise
        except Exception:              # whatever the user's code does with a tracer
            system.compiled["traced"] = False
    return bool(system.compiled["traced"])
