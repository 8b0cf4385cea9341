#!/bin/sh
# Installs what makes a machine record when a camera is plugged in, or takes it away again.
#
#   install.sh [install|uninstall] [--dry-run] [--binary FILE] [--prefix DIR]
#
# --binary FILE   the program; target/release/glintd of this source tree without it
# --prefix DIR    the program goes to DIR/bin; /usr/local without it
# --dry-run       only says what would be done
# The variable DESTDIR names a folder in place of / (for packages and tests): files are copied, nothing else is done.
set -eu

fail() {
    echo "install.sh: $1" >&2
    exit 2
}

here=$(cd "$(dirname "$0")" && pwd)
verb=install
is_dry=no
prefix=/usr/local
binary=${CARGO_TARGET_DIR:-$here/../target}/release/glintd
while [ $# -gt 0 ]; do
    case $1 in
        install | uninstall) verb=$1 ;;
        --dry-run) is_dry=yes ;;
        --binary | --prefix)
            [ $# -ge 2 ] || fail "$1 needs a value"
            case $1 in --binary) binary=$2 ;; --prefix) prefix=$2 ;; esac
            shift
            ;;
        -h | --help)
            sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0"
            exit 0
            ;;
        *) fail "\`$1\` is unknown; see install.sh --help" ;;
    esac
    shift
done
case $prefix in
    /*[!A-Za-z0-9/._-]* | [!/]*) fail "the prefix \`$prefix\` is no absolute path of letters, digits and . _ -" ;;
esac
root=${DESTDIR:-}
root=${root%/}
if [ -z "$root" ] && [ $is_dry = no ] && [ "$(id -u)" != 0 ]; then
    fail "only root may $verb here; run: sudo $0 $verb"
fi

# Does it, or says it.
act() {
    if [ $is_dry = yes ]; then
        echo "would run: $*"
    else
        "$@"
    fi
}

# put FILE TARGET MODE: copies a file where it differs.
put() {
    if [ -f "$root$2" ] && cmp -s "$1" "$root$2" && [ "$(stat -c %a "$root$2")" = "$3" ]; then
        echo "as it was: $2"
    elif [ $is_dry = yes ]; then
        echo "would install: $2"
    else
        install -D -m "$3" "$1" "$root$2"
        echo "installed: $2"
    fi
}

# take TARGET: removes a file.
take() {
    if [ ! -e "$root$1" ]; then
        echo "not there: $1"
    elif [ $is_dry = yes ]; then
        echo "would remove: $1"
    else
        rm -f "$root$1"
        echo "removed: $1"
    fi
}

# Folders that are empty now; those above belong to the system, which is absent under DESTDIR.
sweep() {
    [ $is_dry = no ] || return 0
    rmdir "$root/etc/glint" 2>/dev/null || :
    [ -n "$root" ] || return 0
    for folder in "$prefix/bin" "$prefix" /usr /etc/udev/rules.d /etc/udev /etc/systemd/system /etc/systemd \
        /etc/sysusers.d /etc/tmpfiles.d /etc; do
        rmdir "$root$folder" 2>/dev/null || :
    done
}

has_systemd() {
    [ -z "$root" ] || return 1
    [ -d /run/systemd/system ] || {
        echo "systemd does not run here: users, rules and units take effect where it does"
        return 1
    }
}

program=$prefix/bin/glintd
rules=/etc/udev/rules.d/59-glint.rules
unit=/etc/systemd/system/glintd@.service
sysusers=/etc/sysusers.d/glint.conf
tmpfiles=/etc/tmpfiles.d/glint.conf
config=/etc/glint/glintd.toml

# The unit with the program's place in it.
scratch=$(mktemp)
trap 'rm -f "$scratch"' EXIT
sed "s|/usr/local/bin/glintd|$program|" "$here/glintd@.service" >"$scratch"

if [ $verb = install ]; then
    [ -f "$binary" ] || fail "there is no $binary: run \`cargo build --release -p glintd\`, or give --binary FILE"
    put "$binary" "$program" 755
    put "$here/glint.sysusers" $sysusers 644
    put "$here/glint.tmpfiles" $tmpfiles 644
    if [ -f "$root$config" ] && ! cmp -s "$here/glintd.toml" "$root$config"; then
        echo "yours, left alone: $config"
    else
        put "$here/glintd.toml" $config 644
    fi
    put "$scratch" $unit 644
    # Before the rule, which names the group.
    if has_systemd; then
        act systemd-sysusers $sysusers
        act systemd-tmpfiles --create $tmpfiles
        act systemctl daemon-reload
    fi
    put "$here/59-glint.rules" $rules 644
    if [ -z "$root" ] && [ -d /run/udev ] && command -v udevadm >/dev/null; then
        act udevadm control --reload
        act udevadm trigger --subsystem-match=usb --action=add
    fi
    echo "done: plug a camera in, then: systemctl status 'glintd@*'"
else
    take $rules
    if has_systemd; then
        act systemctl stop 'glintd@*.service'
    fi
    take $unit
    take $sysusers
    take $tmpfiles
    if [ -f "$root$config" ] && ! cmp -s "$here/glintd.toml" "$root$config"; then
        echo "yours, left alone: $config"
    else
        take $config
    fi
    take "$program"
    sweep
    if [ -z "$root" ]; then
        if [ -d /run/systemd/system ]; then act systemctl daemon-reload; fi
        if [ -d /run/udev ] && command -v udevadm >/dev/null; then act udevadm control --reload; fi
    fi
    echo "done: recordings in /var/lib/glint, the user glint and the group capture stay"
fi
