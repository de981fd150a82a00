#!/usr/bin/env bash
# The README's two commands, on the last commit, in a Debian that has nothing but git and make.
#   tests/clean_root.sh SUITE FOLDER       as root; FOLDER is made anew
set -euo pipefail
cd "$(dirname "$0")/.."
suite=$1
root=$(realpath --canonicalize-missing "$2")

if [ "$(id -u)" -ne 0 ] || ! command -v debootstrap >/dev/null; then
    echo "This needs root, for chroot and mounts, and debootstrap (apt-get install debootstrap)." >&2
    exit 1
fi
rm -rf --one-file-system "$root"
debootstrap --variant=minbase --include=ca-certificates,git,make "$suite" "$root"
cp /etc/resolv.conf "$root/etc/"
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"  # with a laboratory's own authorities
git clone --quiet --no-local . "$root/tams"

commands='
set -eu
mount --bind "$1" "$1"  # tests make network namespaces, for which / must be a mount point
mount --rbind /dev "$1/dev"
mount -t tmpfs tmpfs "$1/dev/shm"
mount -t proc proc "$1/proc"
mount -t sysfs -o ro sysfs "$1/sys"
for command in "make run ARGS=--headless" "make test"; do
    started=$(date +%s)
    env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 CI="${CI:-}" \
        chroot "$1" bash -c "cd /tams && $command"
    echo "$command: done after $(($(date +%s) - started)) s"
done
'
# In a mount namespace of its own, so that nothing stays mounted.
unshare --mount --propagation private bash -c "$commands" bash "$root"
