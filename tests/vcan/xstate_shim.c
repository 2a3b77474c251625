/* Preloaded into Debian's linux.uml on processors with AMX.
 *
 * UML 6.1 keeps 2,696 bytes of floating point state per process and hands just those to PTRACE_SETREGSET. A kernel on
 * a processor with AMX insists on its whole state (11,008 bytes) and answers EFAULT, so that no process starts. The
 * layout of the first part is the same, and guests do not use AMX: put that part into a whole state, the rest zero.
 */
enum { PTRACE = 101, PEEK_FIRST = 1, PEEK_LAST = 3, GETREGSET = 0x4204, SETREGSET = 0x4205, XSTATE = 0x202 };
enum { XSTATE_BV = 512, WITHOUT_AMX = 0x2ff };

struct iovec { void *base; unsigned long size; };
extern long syscall(long number, ...);
extern void *memcpy(void *, const void *, unsigned long);
extern void *memset(void *, int, unsigned long);
static char whole[65536] __attribute__((aligned(64)));

long ptrace(long request, long pid, long address, long data)
{
    struct iovec *callers = (struct iovec *)data;
    struct iovec hosts = { whole, sizeof whole };
    long result, word;

    if (request >= PEEK_FIRST && request <= PEEK_LAST) { /* the C library returns the word itself */
        result = syscall(PTRACE, request, pid, address, &word);
        return result < 0 ? result : word;
    }
    if (address != XSTATE || (request != GETREGSET && request != SETREGSET))
        return syscall(PTRACE, request, pid, address, data);
    result = syscall(PTRACE, GETREGSET, pid, address, &hosts); /* sets hosts.size */
    if (result < 0)
        return result;
    if (request == GETREGSET) {
        if (callers->size > hosts.size)
            callers->size = hosts.size;
        memcpy(callers->base, whole, callers->size);
        return result;
    }
    memset(whole, 0, hosts.size);
    memcpy(whole, callers->base, callers->size < hosts.size ? callers->size : hosts.size);
    *(unsigned long *)(whole + XSTATE_BV) &= WITHOUT_AMX;
    return syscall(PTRACE, SETREGSET, pid, address, &hosts);
}
