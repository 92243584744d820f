"""One thread for each call of linear algebra; imported before numpy.

The matrices of a diagnosis are small, and its joints run in threads of their own: more
of them wait for each other, a hundred times longer where another process is busy.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
