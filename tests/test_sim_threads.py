"""XLA's pool of threads does not stand still where processors are few."""

import os
import subprocess
import sys

import pytest

SEVERAL = """
import os
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
import gatjax.search
import jax
import jax.numpy as jnp

def step(m, _):
    def part(k):
        return jnp.tanh(jnp.linalg.cholesky(0.1 * jnp.tanh(m @ m.mT) + k * jnp.eye(32)))
    return sum(part(k) for k in range(3, 11)) / 8, None

many = jnp.broadcast_to(jnp.eye(32), (256, 32, 32))
done = jax.jit(lambda m: jax.lax.scan(step, m, None, length=200)[0])(many)
print(done.block_until_ready().shape)
"""
PATIENCE = 120.0  # s; it takes two


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity"), reason="processors can't be chosen here"
)
def test_factorizations_beside_each_other_do_not_block_each_other_on_two_processors():
    done = subprocess.run(
        [sys.executable, "-c", SEVERAL],
        env={k: v for k, v in os.environ.items() if k != "PJRT_NPROC"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.stdout.strip() == "(256, 32, 32)", done.stderr
