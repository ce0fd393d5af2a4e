#!/bin/sh
# Make this board's USB port a serial port (CDC-ACM), or take that away again.
#
#   usb-gadget.sh [-n] [-r ROOT] [-s SERIAL] start|stop
#
#   -n         say what would be done, and do nothing
#   -r ROOT    work in this folder instead of /, for a trial without USB
#   -s SERIAL  serial number; default: the camera's own, which is made of the machine's id
#
# Here the port is /dev/ttyGS0. What was made by a start that fails is taken away again.
set -eu

root=''
serial=''
dry=''
while getopts 'nr:s:' option; do
    case $option in
    n) dry=1 ;;
    r) root=$OPTARG ;;
    s) serial=$OPTARG ;;
    *) exit 2 ;;
    esac
done
shift $((OPTIND - 1))

gadget=$root/sys/kernel/config/usb_gadget/prismstereo
controllers=$root/sys/class/udc

fail() {
    echo "usb-gadget.sh: $*" >&2
    exit 1
}

run() {
    if [ -n "$dry" ]; then
        echo "$*"
    else
        "$@"
    fi
}

put() { # FILE VALUE
    if [ -n "$dry" ]; then
        echo "echo '$2' > $1"
    else
        echo "$2" >"$1"
    fi
}

drop() { # FOLDER; configfs takes a folder's own files with it, an ordinary folder has to be emptied first
    if [ -n "$root" ] && [ -z "$dry" ]; then
        for entry in "$1"/*; do
            if [ -f "$entry" ]; then rm -- "$entry"; fi
            if [ -d "$entry" ] && [ -z "$(ls -A -- "$entry")" ]; then rmdir -- "$entry"; fi
        done
    fi
    run rmdir -- "$1"
}

own_serial() { # the first 8 bytes that the camera's program names itself by, too
    id=$(cat -- "$root/etc/machine-id" 2>/dev/null || true)
    case $id in
    '' | *[!0-9a-f]*) fail "no machine id in $root/etc/machine-id: give a serial number with -s" ;;
    esac
    printf 'prismstereo device\n%s' "$id" | sha256sum | cut -c 1-16
}

start() {
    [ -n "$serial" ] || serial=$(own_serial)
    case $serial in
    *[!A-Za-z0-9._-]*) fail "serial number '$serial': give letters, digits, '.', '_' and '-'" ;;
    esac
    if [ -z "$root" ] && [ -z "$dry" ] && [ ! -d "${gadget%/*}" ]; then
        modprobe libcomposite
    fi
    controller=$(ls -- "$controllers" 2>/dev/null | head -n 1)
    [ -n "$controller" ] || fail "no USB device controller in $controllers: switch the port to device mode first"
    [ ! -d "$gadget" ] || stop

    if [ -z "$dry" ]; then
        trap 'stop; exit 1' INT TERM
        trap 'stop' EXIT
    fi
    run mkdir -p -- "$gadget"
    put "$gadget/idVendor" 0x1d6b
    put "$gadget/idProduct" 0x0104
    put "$gadget/bcdDevice" 0x0100
    put "$gadget/bcdUSB" 0x0200
    put "$gadget/bDeviceClass" 0x02
    run mkdir -p -- "$gadget/strings/0x409"
    put "$gadget/strings/0x409/serialnumber" "$serial"
    put "$gadget/strings/0x409/manufacturer" prismstereo
    put "$gadget/strings/0x409/product" 'prismstereo camera'
    run mkdir -p -- "$gadget/functions/acm.usb0"
    run mkdir -p -- "$gadget/configs/c.1/strings/0x409"
    put "$gadget/configs/c.1/strings/0x409/configuration" 'serial port'
    put "$gadget/configs/c.1/MaxPower" 250
    run ln -s -- "$gadget/functions/acm.usb0" "$gadget/configs/c.1/acm.usb0"
    put "$gadget/UDC" "$controller"
    trap - EXIT INT TERM
}

stop() {
    trap - EXIT INT TERM
    [ -d "$gadget" ] || [ -n "$dry" ] || return 0
    # Unbinding what is not bound is an error of the kernel's, and none of ours.
    [ ! -e "$gadget/UDC" ] || put "$gadget/UDC" '' 2>/dev/null || true
    [ ! -L "$gadget/configs/c.1/acm.usb0" ] || run rm -- "$gadget/configs/c.1/acm.usb0"
    for folder in configs/c.1/strings/0x409 configs/c.1 functions/acm.usb0 strings/0x409 ''; do
        path=$gadget${folder:+/$folder}
        [ ! -d "$path" ] || drop "$path"
    done
}

case ${1-} in
start) start ;;
stop) stop ;;
*)
    echo 'usage: usb-gadget.sh [-n] [-r ROOT] [-s SERIAL] start|stop' >&2
    exit 2
    ;;
esac
