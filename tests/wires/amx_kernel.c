/* The answers of a kernel whose processor has AMX, for machines that have none: preloaded into user-mode Linux.
 *
 * Its register state has 11008 bytes, of which the real ones come first. Reading fills as much of that as the buffer
 * holds; writing less than all of it is EFAULT.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

enum { STATE_WITH_AMX = 11008 };

typedef long (*ptrace_call)(int request, pid_t pid, void *address, void *data);

long ptrace(enum __ptrace_request request, ...) {
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    ptrace_call next = (ptrace_call)dlsym(RTLD_NEXT, "ptrace");

    if ((uintptr_t)address != NT_X86_XSTATE || (request != PTRACE_SETREGSET && request != PTRACE_GETREGSET))
        return next(request, pid, address, data);
    struct iovec *registers = data;
    if (request == PTRACE_SETREGSET) {
        if (registers->iov_len < STATE_WITH_AMX) {
            errno = EFAULT;
            return -1;
        }
        return next(request, pid, address, data);
    }
    size_t room = registers->iov_len < STATE_WITH_AMX ? registers->iov_len : STATE_WITH_AMX;
    long failed = next(request, pid, address, registers);
    if (failed)
        return failed;
    if (registers->iov_len < room)
        memset((char *)registers->iov_base + registers->iov_len, 0, room - registers->iov_len);
    registers->iov_len = room;
    return 0;
}
