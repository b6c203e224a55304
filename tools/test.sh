#!/usr/bin/env bash
# A suite in two parts side by side: tools/test.sh PYTHON CHOICE [ARGUMENT OF PYTEST]..., CHOICE "not slow" or of slow tests.
#
# What only computes shares the processors, at a lower priority. What holds deadlines (the mark real_time) mostly waits:
# it runs one test after the other and, when its time has come, goes before the rest. Its output follows at the end.
# One of these that fails runs again, twice at most: on a machine that others use, a deadline can be missed that is held
# otherwise. Its line says RERUN, and the summary counts it.
set -u
python=$1 choice=$2
shift 2
# Ordinary tests share what their file has prepared. Slow ones prepare little and differ much in length.
if [ "$choice" = "not slow" ]; then
    spread=(--dist loadfile --no-loadscope-reorder)
else
    spread=(--dist worksteal --timeout 300)
fi
colour=()
[ -t 1 ] && colour=(--color=yes)

said=$(mktemp) || exit 2
trap 'rm -f "$said"' EXIT
{
    # A changed model is compiled here, where no test waits for its rig meanwhile.
    "$python" -c 'from tools.compile_model import compile_rig; compile_rig()' &&
        exec "$python" -m pytest "${colour[@]}" -m "$choice and real_time" --reruns 2 "$@"
} >"$said" 2>&1 </dev/null &
timed_process=$!
trap 'kill "$timed_process" 2>/dev/null; exit 130' INT TERM

nice -n 5 "$python" -m pytest -n auto --maxprocesses 4 "${spread[@]}" \
    -m "$choice and not real_time" "$@"
computed=$?
wait "$timed_process"
timed=$?
cat "$said"

# 5 says: nothing of that kind was chosen.
case $computed-$timed in 0-0 | 0-5 | 5-0) exit 0 ;; *) exit 1 ;; esac
