#!/bin/sh
# Install what the emulated-board tests need on a Debian 12 machine: the Rust target of the board and QEMU >= 9.
#
# Debian 12's own QEMU (7.2) lacks the board; its backports suite has 10. The suite is taken from the mirror that the
# machine already uses: the entry is derived from the existing one, so nothing here names a host. Running it again
# changes nothing. Needs root for the packages only.
set -eu

target=thumbv7em-none-eabihf
machine=olimex-stm32-h405
suite=bookworm-backports

say() { echo "install-emulator: $*"; }

has_machine() {
    command -v qemu-system-arm >/dev/null 2>&1 && qemu-system-arm -M help 2>/dev/null | grep -q "^$machine "
}

# The first entry whose suites include plain `bookworm`, reduced to the backports suite and the component main.
# deb822 entries (`*.sources`) are paragraphs; one-line entries (`*.list`) are `deb [options] URI suite components`.
derive_entry() {
    for file in /etc/apt/sources.list.d/*.sources; do
        [ -e "$file" ] || continue
        entry=$(awk -v suite="$suite" 'BEGIN { RS = ""; FS = "\n" }
            /(^|\n)Suites:[^\n]*[ \t]bookworm([ \t]|\n|$)/ && /(^|\n)Types:[^\n]*deb/ {
                for (i = 1; i <= NF; i++) {
                    if ($i ~ /^#/) continue
                    if ($i ~ /^Types:/) $i = "Types: deb"
                    if ($i ~ /^Suites:/) $i = "Suites: " suite
                    if ($i ~ /^Components:/) $i = "Components: main"
                    print $i
                }
                exit
            }' "$file")
        if [ -n "$entry" ]; then
            printf '%s\n' "$entry" >"/etc/apt/sources.list.d/$suite.sources"
            say "added the suite $suite, derived from $file"
            return 0
        fi
    done
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
        [ -e "$file" ] || continue
        entry=$(sed -n 's/^deb[ \t]\(\(\[[^]]*\][ \t]*\)\{0,1\}[^ \t]*\)[ \t]\{1,\}bookworm[ \t].*/deb \1 '"$suite"' main/p' "$file" | head -n 1)
        if [ -n "$entry" ]; then
            printf '%s\n' "$entry" >"/etc/apt/sources.list.d/$suite.list"
            say "added the suite $suite, derived from $file"
            return 0
        fi
    done
    say "no apt entry for Debian bookworm found to derive $suite from; install QEMU >= 9 (qemu-system-arm) by hand"
    return 1
}

if command -v rustup >/dev/null 2>&1; then
    if rustup target list --installed | grep -qx "$target"; then
        say "target $target is installed"
    else
        say "adding target $target"
        rustup target add "$target"
    fi
elif [ -d "$(rustc --print sysroot)/lib/rustlib/$target" ]; then
    say "target $target is installed"
else
    say "no rustup, and rustc lacks the target $target"
    exit 1
fi

if has_machine; then
    say "$(qemu-system-arm --version | head -n 1) has the machine $machine"
    exit 0
fi

export DEBIAN_FRONTEND=noninteractive
apt-get update -q
if ! apt-cache policy qemu-system-arm | grep -q "$suite"; then
    derive_entry
    apt-get update -q
fi
say "installing qemu-system-arm from $suite"
apt-get install -q -y --no-install-recommends -t "$suite" qemu-system-arm
has_machine || { say "the installed QEMU does not know the machine $machine"; exit 1; }
say "$(qemu-system-arm --version | head -n 1) has the machine $machine"
