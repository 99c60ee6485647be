/* Lets user-mode-linux 6.1 run on processors with more registers than it knows (AMX: tile registers of 8 KiB).
 *
 * It restores a process's registers by PTRACE_SETREGSET with the area that it has room for; since Linux 5.16 the host
 * takes nothing but the whole area (EFAULT else), and so the first process inside dies. Preloaded into linux.uml, this
 * hands over the whole area: what lies beyond is marked as not in use, which it never is inside.
 */
#define _GNU_SOURCE
#include <cpuid.h>
#include <dlfcn.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/uio.h>

#define PTRACE_GETREGSET 0x4204 /* <sys/ptrace.h> declares ptrace otherwise */
#define PTRACE_SETREGSET 0x4205
#define NT_X86_XSTATE 0x202
#define HEADER 512 /* where the area says which parts of it are in use (Intel SDM 1, 13.4) */

typedef long (*Ptrace)(int, int, void *, void *);

static uint64_t parts_within(size_t size)
{
	uint64_t parts = 3; /* x87 and SSE are in the area's first 512 bytes */
	for (unsigned part = 2; part < 63; part++) {
		unsigned length, offset, c, d;
		__cpuid_count(0xD, part, length, offset, c, d);
		if (length && offset + length <= size)
			parts |= 1ull << part;
	}
	return parts;
}

long ptrace(int request, ...)
{
	static Ptrace inner;
	static size_t whole, known;
	static uint64_t parts; /* asked for once: on virtual machines CPUID takes as long as a thousand others */
	static char area[1 << 16];
	va_list given;
	va_start(given, request);
	int pid = va_arg(given, int);
	void *address = va_arg(given, void *), *data = va_arg(given, void *);
	va_end(given);
	if (!inner)
		inner = (Ptrace)dlsym(RTLD_NEXT, "ptrace");
	if (request == PTRACE_SETREGSET && address == (void *)NT_X86_XSTATE) {
		struct iovec *part = data, all = {area, sizeof area};
		if (!whole && inner(PTRACE_GETREGSET, pid, address, &all) == 0)
			whole = all.iov_len;
		if (part->iov_len < whole) {
			memset(area, 0, whole);
			memcpy(area, part->iov_base, part->iov_len);
			if (known != part->iov_len)
				parts = parts_within(known = part->iov_len);
			*(uint64_t *)(area + HEADER) &= parts;
			all.iov_base = area;
			all.iov_len = whole;
			return inner(request, pid, address, &all);
		}
	}
	return inner(request, pid, address, data);
}
