/* For vcanbox.py. User-mode Linux 6.1 sets 2696 bytes of extended processor state; where AMX makes that state larger the
 * host's kernel takes all of it or nothing (EFAULT, and the guest's first process dies). Zeros behind the 2696: AMX not
 * in use.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <string.h>
#include <sys/uio.h>
enum { SETREGSET = 0x4205, NT_X86_XSTATE = 0x202 };
long ptrace(int request, int pid, void *address, void *data)
{
    static long (*next)(int, int, void *, void *);
    static char state[1 << 16] __attribute__((aligned(64)));
    struct iovec whole = { state, sizeof state }, *given = data;
    if (!next)
        next = (long (*)(int, int, void *, void *))dlsym(RTLD_NEXT, "ptrace");
    if (request == SETREGSET && address == (void *)NT_X86_XSTATE && given->iov_len <= sizeof state) {
        memcpy(state, given->iov_base, given->iov_len);
        data = &whole;
    }
    return next(request, pid, address, data);
}
