#!/bin/sh
# Written by `truearc deploy`. Run as root in this folder; running it again does no harm.
set -eu
cd "$(dirname "$0")"
finished=no
trap 'test $finished = yes || echo "NOT FINISHED, and the robot is stopped: fix that and run it again" >&2' EXIT
systemctl stop truearc.service 2>/dev/null || true
id @USER@ >/dev/null 2>&1 || useradd --system --user-group --home-dir @STATE@ --shell /usr/sbin/nologin @USER@
install -d -m 755 @HOME@ @SETTINGS@
install -d -m 755 -o @USER@ -g @USER@ @STATE@ @STATE@/sessions @INBOX@

# The program, and other distributions in plugins/. With wheels for all they need in wheels/ no
# network is asked.
python3 -m venv @HOME@/venv
offline=""
if ls wheels/numpy-*.whl >/dev/null 2>&1; then offline="--no-index"; fi
plugins=$(ls plugins/*.whl 2>/dev/null || true)
@HOME@/venv/bin/python -m pip install --quiet --no-deps --no-index --force-reinstall wheels/truearc-*.whl $plugins
@HOME@/venv/bin/python -m pip install --quiet $offline --find-links wheels --constraint constraints.txt \
    wheels/truearc-*.whl $plugins

# What this computer cannot do.
systemd=$(systemctl --version | sed -n '1s/^systemd \([0-9]*\).*/\1/p')
if [ "${systemd:-0}" -lt 254 ]; then
    sed -i '/^RestartSteps=/d; /^RestartMaxDelaySec=/d' truearc.service
    echo "systemd ${systemd:-of unknown version} cannot back off (254 can): after each end the service starts again in 0.5 s"
fi
if [ -e /sys/fs/cgroup/cgroup.controllers ] && ! grep -qw memory /sys/fs/cgroup/cgroup.controllers; then
    echo "the kernel does not count memory: the service's MemoryMax has no effect" \
        "(on a Raspberry Pi: cgroup_enable=memory in cmdline.txt)"
fi

# What it runs with, and what starts it.
for name in launcher.toml gate.onnx aim.json flat_endpoints.json; do
    if [ -e "$name" ]; then install -m 644 "$name" @SETTINGS@/"$name"; else rm -f @SETTINGS@/"$name"; fi
done
@FILES@

udevadm control --reload
udevadm trigger --action=add --subsystem-match=tty --subsystem-match=video4linux
@NETWORKING@
systemctl daemon-reload
systemctl enable --quiet truearc.service

# Everything is looked at while nothing else holds camera and button box, and with the service's own permissions.
verdict=0
systemd-run --quiet --pipe --wait --collect --property=User=@USER@ --property="SupplementaryGroups=dialout video" \
    --property=LimitRTPRIO=@HIGHEST_PRIORITY@ --property=LimitMEMLOCK=infinity \
    @DOCTOR@ || verdict=$?
systemctl restart --no-block truearc.service
echo "truearc.service is started, and ready once every device has been heard: systemctl status truearc"
finished=yes
exit $verdict
