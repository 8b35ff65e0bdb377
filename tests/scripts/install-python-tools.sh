#!/bin/sh
# Other people's programs that open what crossfall writes: pyarrow, DuckDB, laspy, geojson, in an environment of their own under the build folder.
# The tests that use them say that they skip where there is none.
set -eu
cd "$(dirname "$0")/../.."
folder="${CARGO_TARGET_DIR:-target}/python"
if [ -x "$folder/bin/python" ] && "$folder/bin/python" -c "import pyarrow, duckdb, laspy, lazrs, geojson" 2>/dev/null; then
  exit 0
fi
if ! command -v python3 >/dev/null; then
  echo "  no python3: the tests that open files with pyarrow, DuckDB, laspy and geojson will say that they skip" >&2
  exit 0
fi
echo "  furnishing $folder with pyarrow, duckdb, laspy, geojson" >&2
if ! { python3 -m venv "$folder" && "$folder/bin/pip" install --quiet --disable-pip-version-check pyarrow duckdb laspy lazrs geojson; }; then
  rm -rf "$folder"
  echo "  pip cannot have them: the tests that use them will say that they skip" >&2
fi
