#!/bin/sh
# Install what the tests of the live page need: a chromium, from Debian's own packages. Running it again changes nothing.
set -eu

say() { echo "install-browser: $*"; }

for name in chromium chromium-browser google-chrome; do
    if command -v "$name" >/dev/null 2>&1; then
        say "$name is installed"
        exit 0
    fi
done
if ! command -v apt-get >/dev/null 2>&1; then
    say "no chromium and no apt-get: the tests in a browser will say that they skip"
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -q
apt-get install -q -y --no-install-recommends chromium fonts-dejavu-core
say "chromium is installed"
