"""Takes logs into a data set on Spark: each task runs crossfall on one log and writes its partition.

    spark-submit take_in.py [--road NAME] [--crossfall PATH] DATASET LOG...

Logs and data set must lie on storage that every worker sees. A task that Spark repeats finds its partition there and leaves it.
"""

import argparse
import subprocess
import sys

from pyspark.sql import SparkSession


def take_in(log, dataset, road, program):
    """Runs crossfall on one log; returns the log, its exit status and what was said."""
    command = [program, "profiles", log, "-o", dataset.rstrip("/") + "/"]
    if road:
        command += ["--road", road]
    done = subprocess.run(command, capture_output=True, text=True)
    return log, done.returncode, done.stderr.strip()


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--road", help="name of the road; without it that of each log's folder")
    arguments.add_argument("--crossfall", default="crossfall", help="the program, as every worker finds it")
    arguments.add_argument("dataset")
    arguments.add_argument("log", nargs="+")
    given = arguments.parse_args()

    spark = SparkSession.builder.appName("crossfall").getOrCreate()
    dataset, road, program = given.dataset, given.road, given.crossfall
    logs = spark.sparkContext.parallelize(given.log, len(given.log))
    outcomes = logs.map(lambda log: take_in(log, dataset, road, program)).collect()
    spark.stop()

    failed = 0
    for log, status, said in outcomes:
        print(said, file=sys.stderr)
        # 3: done, but the log had lost data.
        if status not in (0, 3):
            print(f"{log}: crossfall ended with {status}", file=sys.stderr)
            failed += 1
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
