/* A ptrace for user-mode Linux 6.1 that hands over the whole extended register state (XSTATE) of a processor.
 *
 * User-mode Linux keeps the floating-point and vector registers of each process in a buffer of 2696 bytes, which is
 * the state of a processor up to AVX-512, and loads them by PTRACE_SETREGSET. The kernel of the machine takes the
 * whole state or nothing (xstateregs_set in arch/x86/kernel/fpu/regset.c): where the processor also has AMX the state
 * is 11008 bytes, the answer is EFAULT, and user-mode Linux dies before it has booted. Reading is not affected, since
 * there the kernel fills as much as the buffer holds.
 *
 * Preloaded (LD_PRELOAD), this file takes the place of the C library's ptrace. A buffer that is shorter than what the
 * process has now is laid over it and goes out complete. The header of the buffer, XSTATE_BV, says which components
 * it carries; those that lie beyond its end are struck out, so the processor gives them their initial value. That
 * loses nothing: AMX has to be asked for by arch_prctl, which user-mode Linux does not have, so no process inside can
 * have put anything there. All other calls pass unchanged, so it does no harm where the buffer is long enough.
 *
 * tools/with_vcan.sh compiles it: cc -O2 -shared -fPIC uml_xstate.c
 */
#define _GNU_SOURCE
#include <cpuid.h>
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

/* Intel 64 and IA-32 Architectures Software Developer's Manual, volume 1, chapter 13. */
enum {
    XSTATE_BV = 512,      /* where the header of an XSAVE area has its bit map of components */
    HEADER_END = 576,     /* x87, SSE and the header lie before; the extended components behind */
    FIRST_EXTENDED = 2,   /* bits 0 and 1 are x87 and SSE */
    COMPONENTS = 63,      /* bit 63 is no component */
    CPUID_XSTATE = 0x0d,  /* its subleaf i says size (EAX) and place (EBX) of component i */
    LARGEST_STATE = 65536 /* bytes; AMX needs 11008 */
};

typedef long (*ptrace_call)(int request, pid_t pid, void *address, void *data);

/* Of the components in `named` those that end within `length` bytes. */
static uint64_t components_within(uint64_t named, size_t length) {
    for (unsigned i = FIRST_EXTENDED; i < COMPONENTS; i++) {
        unsigned size, offset, ecx, edx;
        if (!(named >> i & 1))
            continue;
        if (!__get_cpuid_count(CPUID_XSTATE, i, &size, &offset, &ecx, &edx) || (size_t)offset + size > length)
            named &= ~(UINT64_C(1) << i);
    }
    return named;
}

long ptrace(enum __ptrace_request request, ...) {
    static ptrace_call next; /* the C library's */
    static unsigned char state[LARGEST_STATE] __attribute__((aligned(64)));
    va_list arguments;

    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    if (!next)
        next = (ptrace_call)dlsym(RTLD_NEXT, "ptrace");

    if (request == PTRACE_SETREGSET && (uintptr_t)address == NT_X86_XSTATE) {
        const struct iovec *given = data;
        struct iovec whole = {state, sizeof state};
        if (given->iov_len >= HEADER_END && next(PTRACE_GETREGSET, pid, address, &whole) == 0 &&
            whole.iov_len > given->iov_len) {
            uint64_t named;
            memcpy(state, given->iov_base, given->iov_len);
            memcpy(&named, state + XSTATE_BV, sizeof named);
            named = components_within(named, given->iov_len);
            memcpy(state + XSTATE_BV, &named, sizeof named);
            return next(request, pid, address, &whole);
        }
    }
    return next(request, pid, address, data);
}
