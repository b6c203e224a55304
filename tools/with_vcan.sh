#!/bin/bash
# with_vcan.sh - run a command where SocketCAN exists: natively if this kernel has it, else in user-mode Linux.
set -u
usage() {
    cat >&2 <<'USAGE'
usage: tools/with_vcan.sh [-t SECONDS] [-m MEMORY] [-w DIRECTORY]... [-u] -- COMMAND [ARGUMENT...]

Runs COMMAND with a virtual CAN bus vcan0 and returns its exit status (124 = time limit, 125 = no SocketCAN to be had).

  -t SECONDS    time limit of the command (default 300)
  -m MEMORY     memory of the user-mode kernel (default 1024M)
  -w DIRECTORY  a directory the command may write to inside user-mode Linux (default: the current one)
  -u            user-mode Linux even if this kernel has vcan

Three ways, in this order:
  1. vcan0 is up on this machine: the command runs as it is.
  2. The kernel has vcan and lets us make a network namespace: the command runs in one of its own, with its own
     127.0.0.1 and vcan0, and nothing stays behind.
  3. The Debian/Ubuntu package user-mode-linux (41 MB, unpacked into ~/.cache/vcan-uml, nothing is installed, root
     is not needed) boots a kernel that has vcan: the machine's files read-only but for -w, its own 127.0.0.1, /tmp
     and TMPDIR in memory, one CPU (before all other processes, where the user may), system calls some ten times
     slower, computing at full speed. On processors with AMX it needs a C compiler (CC, else cc), once.
USAGE
    exit 2
}
fail() { echo "with_vcan: $*" >&2; exit 125; }

limit=300 memory=1024M uml_only='' writable=()
while getopts t:m:w:uh option; do
    case $option in
        t) limit=$OPTARG ;;
        m) memory=$OPTARG ;;
        w) writable+=("$(realpath -e -- "$OPTARG")") || fail "-w $OPTARG: no such directory" ;;
        u) uml_only=1 ;;
        *) usage ;;
    esac
done
shift $((OPTIND - 1))
[ $# -gt 0 ] || usage
[[ $limit =~ ^[0-9]+$ ]] || { echo "with_vcan: -t $limit is not a number of seconds" >&2; exit 2; }
[ ${#writable[@]} -gt 0 ] || writable=("$PWD")

# --- 1. and 2.: natively -------------------------------------------------------------------------------------------
if [ -z "$uml_only" ]; then
    if [ "$(cat /sys/class/net/vcan0/type 2>/dev/null)" = 280 ] && ip link show up dev vcan0 2>/dev/null | grep -q vcan0; then
        exec timeout -k 5 "$limit" "$@"
    fi
    # The module must be in the kernel before a namespace is made: inside one, nothing may load it.
    [ "$(id -u)" = 0 ] && modprobe -q vcan 2>/dev/null
    unshare=(unshare --net)
    [ "$(id -u)" = 0 ] || unshare=(unshare --net --map-root-user)
    # 72 bytes are a frame of CAN FD; once the bus is up, nobody can change it.
    make_bus='ip link set lo up && ip link add vcan0 mtu 72 type vcan && ip link set vcan0 txqueuelen 4096 up'
    if command -v unshare >/dev/null && command -v ip >/dev/null && "${unshare[@]}" sh -c "$make_bus" 2>/dev/null; then
        exec timeout -k 5 "$limit" "${unshare[@]}" sh -c "$make_bus"' && exec "$@"' with_vcan "$@"
    fi
fi

# --- 3.: user-mode Linux -------------------------------------------------------------------------------------------
[ "$(uname -m)" = x86_64 ] || fail "this kernel has no vcan, and user-mode Linux exists for x86_64 only, not for $(uname -m)"
cache=${VCAN_UML_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/vcan-uml}
kernel=$cache/usr/bin/linux.uml
if [ ! -x "$kernel" ]; then
    command -v apt-get >/dev/null && command -v dpkg-deb >/dev/null || fail "this kernel has no vcan, and user-mode Linux comes from apt, which is not here"
    mkdir -p "$cache" || fail "cannot write the cache $cache (VCAN_UML_CACHE chooses another)"
    fetch=$(mktemp -d "$cache/fetch.XXXXXX") || fail "cannot write the cache $cache (VCAN_UML_CACHE chooses another)"
    echo "with_vcan: this kernel has no vcan; fetching user-mode Linux into $cache (41 MB, once)" >&2
    # The scratch directory is world-readable, else apt complains that its sandbox user cannot enter.
    chmod 755 "$fetch"
    (cd "$fetch" && apt-get download -qq user-mode-linux && dpkg-deb -x user-mode-linux_*.deb "$fetch/root") \
        || { rm -rf "$fetch"; fail "apt could not fetch the package user-mode-linux (is 'apt-get update' due?)"; }
    # The kernel moves last: an interrupted fetch never looks like a finished one.
    mkdir -p "$cache/usr/lib" "$cache/usr/bin"
    rm -rf "$cache/usr/lib/uml"
    mv "$fetch/root/usr/lib/uml" "$cache/usr/lib/uml" && mv "$fetch/root/usr/bin/linux.uml" "$kernel"
    rm -rf "$fetch"
fi
[ -x "$kernel" ] || fail "the package user-mode-linux holds no usr/bin/linux.uml"
modules=$cache/usr/lib/uml/modules/$("$kernel" --version)/kernel

# A processor may have more registers than user-mode Linux has room for; see there. Elsewhere it changes nothing, so
# where there is no compiler the kernel is tried without. Its name holds what it was made of: caches outlive sources.
source=$(dirname "$(realpath -- "${BASH_SOURCE[0]}")")/uml_xstate.c
registers=$cache/uml_xstate.$(sha256sum <"$source" | cut -c 1-16).so
compiler_said=''
if [ ! -f "$registers" ]; then
    if command -v "${CC:-cc}" >/dev/null; then
        made=$(mktemp "$cache/uml_xstate.XXXXXX") || fail "cannot write the cache $cache (VCAN_UML_CACHE chooses another)"
        if compiler_said=$("${CC:-cc}" -O2 -shared -fPIC -o "$made" "$source" -ldl 2>&1); then
            mv -f "$made" "$registers"
        else
            rm -f "$made"
            compiler_said="${CC:-cc} could not compile $source: $compiler_said"
        fi
    else
        compiler_said="there is no C compiler ${CC:-cc} here (on Debian and Ubuntu: apt-get install gcc libc6-dev)"
    fi
fi

# User-mode Linux keeps its memory in a file that must be mappable as executable: /dev/shm, unless it is too small.
ram=${UML_TMPDIR:-/dev/shm}
free=$(df -Pm "$ram" 2>/dev/null | awk 'NR == 2 {print $4}')
[ "${free:-0}" -ge 300 ] || ram=${TMPDIR:-/tmp}

# Neither the command line of a kernel nor LD_PRELOAD can quote a space.
[[ ${TMPDIR:-/tmp} == *[[:space:]]* ]] && TMPDIR=/tmp
scratch=$(mktemp -d "${TMPDIR:-/tmp}/with-vcan.XXXXXX") || fail "cannot make a scratch directory"
trap 'rm -rf "$scratch"' EXIT
preload=()
if [ -f "$registers" ] && cp "$registers" "$scratch/uml_xstate.so"; then
    preload=(env "LD_PRELOAD=$scratch/uml_xstate.so${LD_PRELOAD:+:$LD_PRELOAD}")
fi
up="with_vcan: up in $scratch" # what the console shows before this line is the kernel's
# The command and its surroundings travel as files: a kernel command line is too short and quotes too little.
declare -p -x | sed -E '/^declare -x (TMPDIR|HOME|SHLVL|_|OLDPWD|PWD)=/d' >"$scratch/environment"
printf '%q ' "$@" >"$scratch/command"
{
    printf '#!/bin/bash\nscratch=%q modules=%q directory=%q home=%q up=%q\n' "$scratch" "$modules" "$PWD" "$HOME" "$up"
    printf 'writable=('; printf '%q ' "${writable[@]}"; printf ')\n'
    cat <<'INIT'
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=$home
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev 2>/dev/null
mkdir -p /dev/shm /dev/pts
mount -t tmpfs shm /dev/shm
mount -t devpts pts /dev/pts
mount -t tmpfs run /run
ln -sf /proc/self/fd /dev/fd; ln -sf fd/0 /dev/stdin; ln -sf fd/1 /dev/stdout; ln -sf fd/2 /dev/stderr
mount -t hostfs none -o "$scratch" "$scratch"
for each in "${writable[@]}"; do mount -t hostfs none -o "$each" "$each"; done
# finit_module(2) through ctypes: the package kmod need not be there.
python3 -S -E - "$modules" <<'PYTHON'
import ctypes, os, sys
libc = ctypes.CDLL(None, use_errno=True)
for name in "net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev drivers/net/can/vcan".split():
    file = os.open(f"{sys.argv[1]}/{name}.ko", os.O_RDONLY)
    if libc.syscall(313, file, b"", 0):
        print("with_vcan: module", name, os.strerror(ctypes.get_errno()))
PYTHON
ip link set lo up
ip link add vcan0 mtu 72 type vcan && ip link set vcan0 txqueuelen 4096 up
echo up >"$scratch/booted"
# From here on the console is the command's alone: of the kernel only a panic speaks.
echo 1 >/proc/sys/kernel/printk
echo "$up" >/dev/console
(
    . "$scratch/environment"
    export TMPDIR=/dev/shm HOME=$home WITH_VCAN=uml
    cd "$directory" && eval "$(cat "$scratch/command")"
) </dev/null >/dev/console 2>&1
echo $? >"$scratch/status"
sync
python3 -c 'import ctypes; ctypes.CDLL(None).reboot(0x4321FEDC)' || echo o >/proc/sysrq-trigger
INIT
} >"$scratch/init"
chmod +x "$scratch/init"

# One CPU: user-mode Linux is uniprocessor, and its system calls are 2-4 times cheaper without wake-ups across CPUs.
pin=()
if command -v taskset >/dev/null; then
    pin=(taskset -c "${UML_CPU:-$(taskset -pc $$ | sed 's/.*[ ,-]//')}")
fi
# What is real time inside is so only while this kernel has its processor, and priorities inside count for nothing
# outside: where the user may, it goes before others, as a rig does natively. A session of its own, because the
# scheduler shares processors among sessions first and looks at priorities only within each.
first=()
if command -v setsid >/dev/null; then
    first=(setsid bash -c '{ echo -10 >/proc/self/autogroup; renice -n -10 $$; } >/dev/null 2>&1; exec "$@"' uml)
fi
TMPDIR=$ram timeout -k 5 "$limit" "${first[@]}" "${pin[@]}" "${preload[@]}" "$kernel" "mem=$memory" "umid=vcan$$" \
    "uml_dir=$scratch/" rootfstype=hostfs rootflags=/ ro "init=$scratch/init" con=null con0=null,fd:1 ssl=null quiet loglevel=4 \
    </dev/null 2>"$scratch/errors" |
    sed -u -e 's/\r$//' -e "1,\\|^$up\$|{w $scratch/boot" -e 'd}' -e '/^reboot: System halted/d'
kernel_status=${PIPESTATUS[0]}
[ -f "$scratch/status" ] && exit "$(cat "$scratch/status")"
[ "$kernel_status" = 124 ] && { echo "with_vcan: time limit of $limit s" >&2; exit 124; }
[ -f "$scratch/booted" ] && { tail -n 5 "$scratch/errors" >&2; fail "user-mode Linux ended before the command did"; }
{
    echo "with_vcan: user-mode Linux did not boot. The last lines of its kernel:"
    cat "$scratch/errors" "$scratch/boot" | grep -v -E '^( |CPU: |Stack:|Call Trace:|$)' | tail -n 6 | sed 's/^/    /'
    if [ -n "$compiler_said" ]; then
        echo "with_vcan: what $source does for processors with AMX is missing: $compiler_said"
    fi
} >&2
exit 125
