#!/bin/sh
# The survey beside PCL's MSAC on the same simulated sections, in one run. Needs g++ and Debian's libpcl-dev (1.13):
#
#   tests/pcl/run.sh [SECTIONS]
#
# No part of the default tests: it measures time, and PCL is no dependency of the project.
set -eu
cd "$(dirname "$0")/../.."
made=$(mktemp -d)
trap 'rm -rf "$made"' EXIT
pcl=$(ls -d /usr/include/pcl-* | tail -n 1)
cargo build --quiet --release -p crossfall-core --example export_scenes
g++ -std=c++17 -O3 -w -isystem "$pcl" -isystem /usr/include/eigen3 tests/pcl/msac.cpp -o "$made/msac" \
    -lpcl_sample_consensus -lpcl_search -lpcl_kdtree -lpcl_common
echo "crossfall: levelling, search, fits, hinges and intervals of both sides"
"${CARGO_TARGET_DIR:-target}/release/examples/export_scenes" "$made" "${1:-1000}"
for threshold in 0.025 0.010; do
    echo "PCL MSAC, $threshold m: the four lines of a scan, windows given"
    "$made/msac" "$threshold" "$made/plain-3.5.txt" "$made/plain-10.txt" "$made/grass-10.txt"
done
