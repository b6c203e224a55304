/* A loop that does nothing but keep absolute deadlines, 1 ms apart: how late the machine itself is.
 *
 * deadlines SECONDS FILE PROCESSOR PHASE PRIORITY: with 1 ns timer slack and SCHED_FIFO if permitted, like the rig. It
 * runs on that PROCESSOR only. The deadlines are whole milliseconds after PHASE (ns of the monotonic clock). It writes
 * the lateness of every tick as 64-bit integers (ns).
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
    if (argc != 6) return 2;
    long ticks = 1000 * atol(argv[1]);
    int64_t *late = calloc(ticks, sizeof *late);
    struct sched_param priority = {.sched_priority = atoi(argv[5])};
    struct timespec deadline, now;
    cpu_set_t processor;
    CPU_ZERO(&processor);
    CPU_SET(atoi(argv[3]), &processor);
    if (!late || sched_setaffinity(0, sizeof processor, &processor)) return 1;
    prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
    sched_setscheduler(0, SCHED_FIFO, &priority); /* a privilege that it need not have */
    clock_gettime(CLOCK_MONOTONIC, &deadline);
    long phase = (atoll(argv[4]) - deadline.tv_nsec) % 1000000;
    deadline.tv_nsec += phase < 0 ? phase + 1000000 : phase;
    for (long k = 0; k < ticks; k++) {
        deadline.tv_nsec += 1000000;
        while (deadline.tv_nsec >= 1000000000) {
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
