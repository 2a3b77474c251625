from .diagnosis import bench_of as bench_of
from .runs import read_bench as read_bench
