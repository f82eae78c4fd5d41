#!/usr/bin/env bash
# A real boot: Debian bookworm in a container, the wheel installed, the service started, a stand-in hand shadowed. Then daemon
# and workbench are stopped (kill -STOP) and killed (kill -9) and the whole system is rebooted: each time everything must come
# back by itself.
# Needs root, debootstrap, systemd-nspawn, nsenter and a Debian mirror; where one is missing it says so in a line and ends
# with 0, or with 77 if BOOT_STRICT is set. BOOT_CACHE (build/boot) keeps the bare system and the packages.
# With BOOT_ROS=1 the system gets ROS 2 as well, and the bridge is treated in the same way.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cache=$(realpath -m "${BOOT_CACHE:-build/boot}")
mirror=${BOOT_MIRROR:-http://deb.debian.org/debian}
python=$(realpath -s "${PYTHON:-.venv/bin/python}")
# The most seconds until a unit does its work again after kill -STOP and after kill -9: its watchdog, then its start.
declare -A stop_s=([twin-daemon]=5 [twin-workbench]=20 [twin-bridge-ros2]=15)
declare -A kill_s=([twin-daemon]=5 [twin-workbench]=10 [twin-bridge-ros2]=10)
units=(twin-daemon twin-workbench ${BOOT_ROS:+twin-bridge-ros2})

skip() { echo "boot test left out: $1"; exit "$([ -n "${BOOT_STRICT:-}" ] && echo 77 || echo 0)"; }
[ "$(id -u)" = 0 ] || skip "it needs root"
for tool in debootstrap systemd-nspawn nsenter runuser; do
    command -v "$tool" >/dev/null || skip "$tool is not on this machine"
done
[ -d "$cache/base" ] || "$python" - "$mirror" <<'PY' 2>/dev/null || skip "no Debian mirror answers at $mirror"
import sys, urllib.request
urllib.request.urlopen(sys.argv[1] + "/dists/bookworm/Release", timeout=10).read(100)
PY

mkdir -p "$cache"
run=$(mktemp -d "$cache/run.XXXXXX")
root=$run/root
container=
end() {
    if [ -n "$container" ] && kill -0 "$container" 2>/dev/null; then
        # nspawn ends the system inside at its second SIGTERM at the latest
        kill -TERM "$container" 2>/dev/null || true
        timeout 10 tail --pid="$container" -f /dev/null || kill -KILL "$container" 2>/dev/null || true
        wait "$container" 2>/dev/null || true
    fi
    while read -r _ place _; do
        case $place in "$run"/*) umount -l "$place" || true ;; esac
    done < /proc/self/mounts
    rm -rf --one-file-system "$run"
}
trap end EXIT
trap 'exit 130' INT TERM

echo "bare system"
if [ ! -d "$cache/base" ]; then
    rm -rf --one-file-system "$cache/base.part"
    timeout 900 debootstrap --variant=minbase --include=systemd,systemd-sysv,dbus,python3,python3-venv,procps \
        bookworm "$cache/base.part" "$mirror" > "$cache/debootstrap.log" 2>&1 || {
        tail -3 "$cache/debootstrap.log"
        exit 1
    }
    mv "$cache/base.part" "$cache/base"
fi

echo "wheel and its packages"
"$python" -m hatchling build -t wheel -d "$run/wheel" > /dev/null 2>&1
twin=/opt/twin_daemon/.venv/bin/twin
locks=(requirements.lock)
if [ -n "${BOOT_ROS:-}" ]; then locks+=(requirements-ros.lock); fi
lock=$(cat "${locks[@]}" | sha256sum | cut -c1-16)
ready=$cache/with-packages-$lock
if [ ! -d "$ready" ]; then
    "$python" -m pip --version > /dev/null 2>&1 && pip=$python || pip=python3
    "$pip" -m pip download -qqq --no-deps --only-binary=:all: --python-version 3.11 --require-hashes \
        -r requirements.lock -d "$cache/wheels-$lock"
    if [ -n "${BOOT_ROS:-}" ]; then  # one package of it has no wheel, so this Python has to be a 3.11 as well
        "$pip" -m pip wheel -qqq --no-deps --require-hashes -r requirements-ros.lock -w "$cache/wheels-$lock"
    fi
    cp -a --reflink=auto "$cache/base" "$ready.part"
    mkdir -p "$ready.part/opt/wheels"
    cp "$cache/wheels-$lock"/*.whl "$run"/wheel/*.whl "$ready.part/opt/wheels/"
    chroot "$ready.part" python3 -m venv /opt/twin_daemon/.venv
    chroot "$ready.part" /opt/twin_daemon/.venv/bin/python -m pip install -q --no-index --find-links /opt/wheels \
        "twin_daemon${BOOT_ROS:+[ros]}"
    rm -r "$ready.part/opt/wheels" "$cache/wheels-$lock"
    mv "$ready.part" "$ready"
fi
cp -a --reflink=auto "$ready" "$root"
cp "$run"/wheel/*.whl "$root/opt/"
chroot "$root" /bin/sh -c "/opt/twin_daemon/.venv/bin/python -m pip install -q --no-index --no-deps --force-reinstall /opt/*.whl"
cp tools/boot_probe.py "$root/opt/boot_probe.py"

echo "service"
chroot "$root" "$twin" service install
cat > "$root/etc/systemd/system/stand-in.service" <<'UNIT'
[Service]
User=twin
ExecStart=/opt/twin_daemon/.venv/bin/twin hand --hidden backlash:rh_FFJ3=0.05
Environment=TWIN_STATE_DIR=/tmp
[Install]
WantedBy=multi-user.target
UNIT
systemctl --root="$root" enable --quiet stand-in.service

boot() {
    systemd-nspawn -D "$root" --boot --register=no --keep-unit --private-network --quiet \
        < /dev/null >> "$run/console.log" 2>&1 &
    container=$!
}
echo "boot"
boot

inside() {
    local init
    init=$(ps -o pid= --ppid "$container" | head -1 | tr -d ' ')
    [ -n "$init" ] || return 1
    nsenter -t "$init" -m -u -i -n -p -- "$@"
}
probe() { inside /opt/twin_daemon/.venv/bin/python /opt/boot_probe.py "$@"; }
fail() {
    echo "boot test FAILED: $1"
    inside journalctl --no-pager -n 60 -u 'twin-*' || tail -20 "$run/console.log"
    exit 1
}
version=
check() {  # words, unit, signal, the most seconds
    local answer seconds
    answer=$(probe "$2" "$3" $([ "$2" = twin-daemon ] && echo "$version")) || fail "$2, $1: it does not do its work"
    read -r seconds found <<< "$answer"
    echo "$2, $1: after $seconds s ${found:0:12}"
    awk -v took="$seconds" -v most="$4" 'BEGIN { exit took > most }' || fail "$2, $1: $seconds s are more than $4 s"
}
check_all() {  # words, the most seconds
    local unit
    for unit in "${units[@]}"; do check "$1" "$unit" 0 "$2"; done
}
wait_up() {
    local began=$SECONDS
    until inside systemctl is-active --quiet twin-daemon 2>/dev/null; do
        [ $((SECONDS - began)) -lt 90 ] || fail "the daemon is not ready 90 s after the boot"
        sleep 0.2
    done
}

wait_up
check_all "booted" 60
inside runuser -u twin -- env TWIN_STATE_DIR=/var/lib/twin_daemon "$twin" versions promote real_closing > /dev/null
version=$(inside runuser -u twin -- env TWIN_STATE_DIR=/var/lib/twin_daemon "$twin" versions show current --json - 2> /dev/null \
    | "$python" -c 'import json, sys; print(json.load(sys.stdin)["id"])')
check "promoted" twin-daemon 0 10
for unit in "${units[@]}"; do
    [ "$(inside systemctl show -p NRestarts --value "$unit")" = 0 ] || fail "$unit was restarted without a cause"
done
for unit in "${units[@]}"; do
    check "kill -STOP" "$unit" 19 "${stop_s[$unit]}"
    check "kill -9" "$unit" 9 "${kill_s[$unit]}"
done
inside systemctl reload twin-daemon
inside systemctl is-active --quiet twin-daemon || fail "the daemon did not survive a reload"

began=$SECONDS
inside systemctl reboot
# a container that reboots ends with 133, and whoever runs it starts it again
timeout 60 tail --pid="$container" -f /dev/null || fail "the system does not go down"
wait "$container" && code=0 || code=$?
[ "$code" = 133 ] || fail "the system ended with $code instead of rebooting"
boot
wait_up
check_all "rebooted" 30
echo "reboot: everything was back $((SECONDS - began)) s after it was asked for"
inside "$twin" service status
inside "$twin" service uninstall > /dev/null
[ -d "$root/var/lib/twin_daemon" ] || fail "uninstall removed the state"
[ ! -e "$root/etc/systemd/system/twin-daemon.service" ] || fail "uninstall left a unit"
echo "boot test passed"
