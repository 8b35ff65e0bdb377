#!/bin/sh
# Other people's programs that open what crossfall writes, in an environment of their own under the build folder: pyarrow, DuckDB, laspy, geojson;
# and Spark, which takes half a gigabyte there and wants a Java (Debian's default-jre-headless where there is none).
#
# With the word `missing` it installs nothing and says what is not there: one line each, for the tests that will say that they skip.
set -eu
cd "$(dirname "$0")/../.."
folder="${CARGO_TARGET_DIR:-target}/python"
tools="pyarrow duckdb laspy lazrs geojson"

has() { [ -x "$folder/bin/python" ] && "$folder/bin/python" -c "import $(echo "$*" | tr ' ' ,)" 2>/dev/null; }
has_java() { command -v java >/dev/null 2>&1 || [ -x "${JAVA_HOME:-}/bin/java" ]; }
say() { echo "  $*" >&2; }

if [ "${1:-}" = missing ]; then
  # shellcheck disable=SC2086
  has $tools || echo "pyarrow, DuckDB, laspy and geojson (Python packages): no file is opened by a program that is not ours"
  has pyspark || echo "pyspark (a Python package): the Spark job is not run"
  has_java || echo "a Java: the Spark job is not run"
  exit 0
fi

if ! command -v python3 >/dev/null; then
  say "no python3: nothing will open what crossfall writes"
  exit 0
fi
# shellcheck disable=SC2086
if ! has $tools; then
  say "furnishing $folder with $tools"
  if ! { python3 -m venv "$folder" && "$folder/bin/pip" install --quiet --disable-pip-version-check $tools; }; then
    rm -rf "$folder"
    say "pip cannot have them"
    exit 0
  fi
fi
if ! has_java; then
  if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    say "installing a Java for Spark"
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update -q && apt-get install -q -y --no-install-recommends default-jre-headless; } >&2 || say "there is no Java to be had"
  else
    say "no Java, and no apt-get or no right to use it: install one for the Spark job"
  fi
fi
if has_java && ! has pyspark; then
  say "furnishing $folder with pyspark"
  "$folder/bin/pip" install --quiet --disable-pip-version-check pyspark || say "pip cannot have it"
fi
