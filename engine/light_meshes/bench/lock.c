/* Who holds Python's lock (threads.py). */
#include "native.h"

/* Asks again and again, until `over`, whether a thread holds the lock: polls[0] is how often, polls[1] how often one did.
   holder: the address of a function without arguments, which returns that thread or null. */
KERNEL(lock_watched, "holder u64  over u8[1]  polls i64[2]!")
i64 lock_watched(u64 holder, const u8 *over, i64 *polls) {
    void *(*of)(void) = (void *(*)(void))(uintptr_t)holder;
    while (!*(const volatile u8 *)over) {
        for (volatile int wait = 0; wait < 500; wait++) {}
        polls[0]++, polls[1] += of() != 0;
    }
    return 0;
}
