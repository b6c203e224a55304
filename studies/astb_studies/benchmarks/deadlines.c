/* A loop that does nothing but keep absolute deadlines, 1 ms apart: how late the machine itself is.
 *
 * deadlines SECONDS FILE: sharpened as the rig sharpens itself (1 ns timer slack, SCHED_FIFO 10 if it may), writes the
 * lateness of every tick as 64-bit integers (ns).
 */
#define _GNU_SOURCE
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>

int main(int argc, char **argv)
{
    if (argc != 3) return 2;
    long ticks = 1000 * atol(argv[1]);
    int64_t *late = calloc(ticks, sizeof *late);
    struct sched_param priority = {.sched_priority = 10};
    struct timespec deadline, now;
    if (!late) return 1;
    prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
    sched_setscheduler(0, SCHED_FIFO, &priority); /* a privilege that it need not have */
    clock_gettime(CLOCK_MONOTONIC, &deadline);
    for (long k = 0; k < ticks; k++) {
        deadline.tv_nsec += 1000000;
        if (deadline.tv_nsec >= 1000000000) {
            deadline.tv_nsec -= 1000000000;
            deadline.tv_sec++;
        }
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL) != 0) {}
        clock_gettime(CLOCK_MONOTONIC, &now);
        late[k] = (now.tv_sec - deadline.tv_sec) * 1000000000LL + now.tv_nsec - deadline.tv_nsec;
    }
    FILE *file = fopen(argv[2], "wb");
    if (!file) return 1;
    size_t written = fwrite(late, sizeof *late, ticks, file);
    return fclose(file) != 0 || written != (size_t)ticks;
}
