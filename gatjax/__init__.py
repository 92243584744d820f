"""Robot logs in; a simulator that agrees with them, and a walk that transfers, out.

jaxlib before 0.11.2 shares each batched factorization on a CPU among the threads of
XLA's pool and waits for them in one of these threads, so a pool of two or three stands
still for ever when as many factorizations begin at once, as MJX's do. XLA reads the
size of the pool once, when JAX first computes, which some libraries do as they load.
"""

import os

__version__ = "0.1.0"

THREADS = 32  # more than factorizations begin at once; 3 to 32 are as fast on two cores
os.environ.setdefault("PJRT_NPROC", str(max(THREADS, os.cpu_count() or 1)))
