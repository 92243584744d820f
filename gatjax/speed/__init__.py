"""How fast a search is, beside bare loops of the same engines, and what it spends."""

from gatjax.speed.bench import Asked, measure, table
from gatjax.speed.picture import draw

__all__ = ["Asked", "draw", "measure", "table"]
