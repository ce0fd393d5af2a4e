#!/bin/sh
# Hand an update that waits in the camera's state folder to the system's own updater, and clear it away once that took it.
#
#   install-update.sh STATE COMMAND...
#
# e.g. install-update.sh /var/lib/private/prismstereo rauc install
# The payload's file is put behind the command. The firmware has checked the bundle's signature; the updater checks its own.
set -eu

if [ $# -lt 2 ]; then
    echo 'usage: install-update.sh STATE COMMAND...' >&2
    exit 2
fi
waiting=$1/update
shift
[ -f "$waiting/ready" ] || exit 0

value() { sed -n "s/^$1=\([0-9a-f]*\)\$/\1/p" "$waiting/ready"; }

payload=$(mktemp)
trap 'rm -f -- "$payload"' EXIT
tail -c "$(value size)" -- "$waiting/bundle" >"$payload"
echo "$(value sha256)  $payload" | sha256sum --check --quiet
"$@" "$payload"
rm -- "$waiting/ready" "$waiting/bundle"
