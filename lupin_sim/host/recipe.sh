#!/bin/sh
# What mmdebstrap's tree needs to be a robot's root: a user, no consoles, no work that an idle robot wouldn't do.
set -eu
root=$1
chroot "$root" useradd --create-home --shell /bin/bash --uid 1000 --groups sudo,dialout,video,plugdev mirte
echo 'mirte:mirte_mirte' | chroot "$root" chpasswd
# Ubuntu, which the robot runs, sets this; Debian's SSH sessions have no sbin without it.
echo 'PATH="/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"' > "$root/etc/environment"
# There is no internet in there: chrony gets its sources from whoever sets the clock up.
sed -i 's/^pool /#pool /' "$root/etc/chrony/chrony.conf"
rm -f "$root"/etc/ssh/ssh_host_*
: > "$root/etc/resolv.conf"
mkdir -p "$root/var/log/journal"
chroot "$root" systemctl --quiet enable systemd-networkd ssh chrony
chroot "$root" systemctl --quiet mask systemd-networkd-wait-online.service getty@.service serial-getty@.service \
  console-getty.service e2scrub_reap.service e2scrub_all.timer apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer \
  fstrim.timer systemd-pstore.service systemd-binfmt.service modprobe@drm.service modprobe@dm_mod.service \
  modprobe@efi_pstore.service sys-kernel-debug.mount sys-kernel-tracing.mount sys-fs-fuse-connections.mount \
  proc-sys-fs-binfmt_misc.automount
