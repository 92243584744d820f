"""Searches on several hosts: one leads, the others come and go.

A generation needs little of the network: a policy is 15 numbers and a rollout one cost,
24 kB for 150 policies x 20 rollouts. So the leader asks and tells, and every host runs
its share of the policies on its own devices. A host that dies costs its share's time.

`jax.distributed` was tried first (0.10.2, two processes on loopback): one host's death
aborts the others inside C++, a host that is 30 s slower than another counts as dead
(Gloo), and nobody can join later.
"""

from gatjax.hosts.crew import Crew
from gatjax.hosts.wire import Task, address_of
from gatjax.hosts.work import serve

__all__ = ["Crew", "Task", "address_of", "serve"]
