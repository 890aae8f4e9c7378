#!/bin/sh
# Puts Slurm (the host's Debian's) into FOLDER, with what it needs and the host lacks; the host stays as it is. 15 MB.
#   usage: sh install_slurm.sh FOLDER
set -eu
P=$(mkdir -p "$1/debs/partial" && cd "$1" && pwd)
[ ! -x "$P/usr/sbin/slurmd-wlm" ] || exit 0
ls /var/lib/apt/lists/*Packages* >/dev/null 2>&1 || apt-get -q update
apt-get -q -y --no-install-recommends --download-only -o Debug::NoLocking=1 -o APT::Sandbox::User=root \
  -o Dir::Cache::archives="$P/debs" install slurmctld slurmd slurm-client
for deb in "$P"/debs/*.deb; do dpkg-deb --fsys-tarfile "$deb" | tar -x -C "$P" --no-same-owner; done
rm -rf "$P/debs"
L=$P/usr/lib/x86_64-linux-gnu
LD_LIBRARY_PATH=$L:$L/slurm-wlm "$P/usr/sbin/slurmd-wlm" -V
