# CAN is systemd-networkd's, whatever else looks after the network. A new name comes with the next plugging in.
if [ -d /etc/NetworkManager ]; then systemctl try-reload-or-restart NetworkManager.service; fi
if ! systemctl is-enabled --quiet systemd-networkd.service; then
    systemctl enable systemd-networkd.service
    # nothing but CAN is networkd's here: a start that waits for "online" would wait in vain
    systemctl disable systemd-networkd-wait-online.service
fi
if [ -e /sys/class/net/@CHANNEL@ ]; then udevadm trigger --action=add /sys/class/net/@CHANNEL@; fi
systemctl restart systemd-networkd.service
