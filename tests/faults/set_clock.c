/* A system clock that can be set while a process runs, and not the machine's: preload this, and have the file that
 * TRACKWAY_CLOCK_OFF names hold the seconds by which CLOCK_REALTIME is off, as int64. Other clocks stay as they are.
 *
 * Who waits until an instant of that clock waits longer where it is set back, as the kernel has it: the libraries of
 * the wheels do, for they are built for a C library that knows no waiting by the steady clock. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

typedef struct timespec Time;
static int (*true_gettime)(clockid_t, Time *);
static int (*true_cond)(pthread_cond_t *, pthread_mutex_t *, const Time *);
static int (*true_mutex)(pthread_mutex_t *, const Time *);
static int (*true_semaphore)(sem_t *, const Time *);
static volatile int64_t *seconds_off;

static void __attribute__((constructor)) prepare(void) {
    true_gettime = (int (*)(clockid_t, Time *))dlsym(RTLD_NEXT, "clock_gettime");
    true_mutex = (int (*)(pthread_mutex_t *, const Time *))dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
    true_semaphore = (int (*)(sem_t *, const Time *))dlsym(RTLD_NEXT, "sem_timedwait");
    void *cond = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2"); /* on x86 there is an older one, too */
    cond = cond ? cond : dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    true_cond = (int (*)(pthread_cond_t *, pthread_mutex_t *, const Time *))cond;
    const char *path = getenv("TRACKWAY_CLOCK_OFF");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *map = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *seconds_off, PROT_READ, MAP_SHARED, file, 0);
    if (map != MAP_FAILED)
        seconds_off = map;
    if (file >= 0)
        close(file);
}

int clock_gettime(clockid_t clock, Time *now) {
    if (!true_gettime)
        prepare();
    int failed = true_gettime(clock, now);
    if (!failed && clock == CLOCK_REALTIME && seconds_off)
        now->tv_sec += *seconds_off;
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    (void)zone;
    Time exact;
    int failed = clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return failed;
}

/* Instants of the steady clock, which other waits are told, are small. */
static int is_of_system_clock(const Time *until) { return until->tv_sec > 1000000000; }

static int is_over(const Time *until) {
    Time now;
    clock_gettime(CLOCK_REALTIME, &now);
    return now.tv_sec > until->tv_sec || (now.tv_sec == until->tv_sec && now.tv_nsec >= until->tv_nsec);
}

/* A moment from now on the machine's own clock, or the instant itself where that comes sooner. */
static Time soon(const Time *until) {
    Time next, now;
    true_gettime(CLOCK_REALTIME, &next);
    clock_gettime(CLOCK_REALTIME, &now);
    int64_t left = (until->tv_sec - now.tv_sec) * 1000000000LL + until->tv_nsec - now.tv_nsec;
    next.tv_nsec += left < 0 ? 0 : left < 5000000 ? left : 5000000;
    if (next.tv_nsec >= 1000000000) {
        next.tv_nsec -= 1000000000;
        next.tv_sec += 1;
    }
    return next;
}

int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex, const Time *until) {
    int failed;
    if (!is_of_system_clock(until))
        return true_cond(cond, mutex, until);
    do {
        Time next = soon(until);
        failed = true_cond(cond, mutex, &next);
    } while (failed == ETIMEDOUT && !is_over(until));
    return failed;
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const Time *until) {
    int failed;
    do {
        Time next = soon(until);
        failed = true_mutex(mutex, &next);
    } while (failed == ETIMEDOUT && !is_over(until));
    return failed;
}

int sem_timedwait(sem_t *semaphore, const Time *until) {
    int failed;
    do {
        Time next = soon(until);
        failed = true_semaphore(semaphore, &next);
    } while (failed && errno == ETIMEDOUT && !is_over(until));
    return failed;
}
