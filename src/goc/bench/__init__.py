"""`goc bench`: the paper's tables, measured again."""

from goc.bench.config import SUITES, BenchConfig
from goc.bench.stage import bench

__all__ = ["SUITES", "BenchConfig", "bench"]
