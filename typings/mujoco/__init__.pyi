# MuJoCo's Python interface is compiled and ships no types: pyright takes it as Any.
from typing import Any

def __getattr__(name: str) -> Any: ...
