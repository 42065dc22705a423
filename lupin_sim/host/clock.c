/* The wall clock of one simulated computer, as a library that is preloaded into every program on it.
 *
 * All programs map one page. It holds what the wall clock showed at some instant of the clock of the machine that runs the
 * simulation ("the machine's clock"), the error of the crystal, and the corrections of a clock discipline. The functions below
 * read and set the time in this page, without a system call that could change the machine's clock. They cover calls through libc
 * only: static programs, file times and the kernel's timers on the real-time clock use the machine's clock. A user who cannot open
 * the page for writing may not set the clock.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timex.h>
#include <time.h>
#include <unistd.h>

#define PAGE_PATH "/run/lupin-clock"
#define MAGIC 0x4b434f4c /* "LOCK" */
#define NS 1000000000LL
#define MODE_ADJTIME 0x8000 /* ADJ_ADJTIME: the call is an old adjtime(), and the other bits of `modes` select no fields */

/* Must match PAGE in clock.py. */
struct page {
  uint32_t sequence; /* odd during a write */
  uint32_t magic;
  int64_t wall_ns, machine_ns; /* the same instant on both clocks */
  int64_t crystal_ppb;         /* rate error of the oscillator */
  int64_t frequency;           /* rate correction by the discipline, 2^-16 ppm as in adjtimex */
  int64_t tick_us;
  int64_t status, maxerror_us, esterror_us, constant;
  int64_t steps; /* how often the clock was set or stepped */
};

static struct page *page;
static int writable;

__attribute__((constructor)) static void open_page(void) {
  int fd = open(PAGE_PATH, O_RDWR | O_CLOEXEC);
  writable = fd >= 0;
  if (fd < 0) fd = open(PAGE_PATH, O_RDONLY | O_CLOEXEC);
  if (fd < 0) return;
  void *at = mmap(NULL, sizeof(struct page), PROT_READ | (writable ? PROT_WRITE : 0), MAP_SHARED, fd, 0);
  close(fd);
  if (at != MAP_FAILED && ((struct page *)at)->magic == MAGIC) page = at;
}

static int64_t nanoseconds(struct timespec t) { return t.tv_sec * NS + t.tv_nsec; }

static int64_t machine_now(void) {
  struct timespec t;
  syscall(SYS_clock_gettime, CLOCK_REALTIME, &t);
  return nanoseconds(t);
}

static int64_t wall_at(const struct page *p, int64_t machine_ns) {
  int64_t rate_ppb = p->crystal_ppb + p->frequency * 1000 / 65536 + (p->tick_us - 10000) * 100000;
  int64_t elapsed = machine_ns - p->machine_ns;
  return p->wall_ns + elapsed + (int64_t)((__int128)elapsed * rate_ppb / NS);
}

static int64_t wall_now(void) {
  for (;;) {
    uint32_t before = __atomic_load_n(&page->sequence, __ATOMIC_ACQUIRE);
    if (before & 1) continue;
    int64_t value = wall_at(page, machine_now());
    __atomic_thread_fence(__ATOMIC_ACQUIRE);
    if (before == __atomic_load_n(&page->sequence, __ATOMIC_RELAXED)) return value;
  }
}

/* Begin a change. The present time becomes the page's instant, so that a new rate applies from now on. */
static void begin_change(void) {
  uint32_t even;
  do even = __atomic_load_n(&page->sequence, __ATOMIC_RELAXED) & ~1u;
  while (!__atomic_compare_exchange_n(&page->sequence, &even, even + 1, 0, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED));
  int64_t now = machine_now();
  page->wall_ns = wall_at(page, now);
  page->machine_ns = now;
}

static void end_change(void) { __atomic_add_fetch(&page->sequence, 1, __ATOMIC_RELEASE); }

/* As the kernel does after a step: the clock counts as unsynchronized. */
static void mark_stepped(void) {
  page->status |= STA_UNSYNC;
  page->maxerror_us = page->esterror_us = 16000000;
  page->steps++;
}

static int set_wall(int64_t value_ns) {
  if (!writable) return errno = EPERM, -1;
  begin_change();
  page->wall_ns = value_ns;
  mark_stepped();
  end_change();
  return 0;
}

int clock_gettime(clockid_t id, struct timespec *out) {
  if (!page || (id != CLOCK_REALTIME && id != CLOCK_REALTIME_COARSE && id != CLOCK_TAI))
    return (int)syscall(SYS_clock_gettime, id, out);
  int64_t now = wall_now();
  out->tv_sec = now / NS;
  out->tv_nsec = now % NS;
  return 0;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone) {
  struct timespec now;
  if (clock_gettime(CLOCK_REALTIME, &now)) return -1;
  *out = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
  if (zone) memset(zone, 0, sizeof(struct timezone));
  return 0;
}

time_t time(time_t *out) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (out) *out = now.tv_sec;
  return now.tv_sec;
}

int timespec_get(struct timespec *out, int base) {
  return base == TIME_UTC && clock_gettime(CLOCK_REALTIME, out) == 0 ? base : 0;
}

int clock_settime(clockid_t id, const struct timespec *value) {
  if (!page || id != CLOCK_REALTIME) return (int)syscall(SYS_clock_settime, id, value);
  return set_wall(nanoseconds(*value));
}

int settimeofday(const struct timeval *value, const struct timezone *zone) {
  if (!page) return (int)syscall(SYS_settimeofday, value, zone);
  return value ? set_wall(value->tv_sec * NS + value->tv_usec * 1000LL) : 0;
}

static void apply_timex(const struct timex *x) {
  unsigned modes = x->modes;
  int64_t unit_ns = (modes & ADJ_NANO) || (page->status & STA_NANO) ? 1 : 1000;
  if (modes & MODE_ADJTIME) { /* adjtime(): apply the whole offset at once; no present clock discipline uses it */
    page->wall_ns += x->offset * 1000LL;
    return;
  }
  if (modes & ADJ_SETOFFSET) {
    page->wall_ns += x->time.tv_sec * NS + x->time.tv_usec * (modes & ADJ_NANO ? 1 : 1000LL);
    mark_stepped();
  }
  if (modes & ADJ_OFFSET) page->wall_ns += x->offset * unit_ns;
  if (modes & ADJ_FREQUENCY) {
    int64_t limit = 500LL << 16;
    page->frequency = x->freq > limit ? limit : x->freq < -limit ? -limit : x->freq;
  }
  if (modes & ADJ_MAXERROR) page->maxerror_us = x->maxerror;
  if (modes & ADJ_ESTERROR) page->esterror_us = x->esterror;
  if (modes & ADJ_STATUS) page->status = (page->status & STA_RONLY) | (x->status & ~STA_RONLY);
  if (modes & ADJ_TIMECONST) page->constant = x->constant;
  if (modes & ADJ_NANO) page->status |= STA_NANO;
  if (modes & ADJ_MICRO) page->status &= ~STA_NANO;
  if (modes & ADJ_TICK) page->tick_us = x->tick;
}

int adjtimex(struct timex *x) {
  if (!page) return (int)syscall(SYS_adjtimex, x);
  if (x->modes && x->modes != ADJ_OFFSET_SS_READ) {
    if (!writable) return errno = EPERM, -1;
    if (!(x->modes & MODE_ADJTIME) && (x->modes & ADJ_TICK) && (x->tick < 9000 || x->tick > 11000)) return errno = EINVAL, -1;
    begin_change();
    apply_timex(x);
    end_change();
  }
  int64_t now = wall_now();
  unsigned modes = x->modes;
  memset(x, 0, sizeof *x);
  x->modes = modes;
  x->freq = page->frequency;
  x->maxerror = page->maxerror_us;
  x->esterror = page->esterror_us;
  x->status = (int)page->status;
  x->constant = page->constant;
  x->precision = 1;
  x->tolerance = 500L << 16;
  x->tick = page->tick_us;
  x->time.tv_sec = now / NS;
  x->time.tv_usec = page->status & STA_NANO ? now % NS : now % NS / 1000;
  return page->status & STA_UNSYNC ? TIME_ERROR : TIME_OK;
}

int ntp_adjtime(struct timex *x) { return adjtimex(x); }

int clock_adjtime(clockid_t id, struct timex *x) {
  return page && id == CLOCK_REALTIME ? adjtimex(x) : (int)syscall(SYS_clock_adjtime, id, x);
}

/* Convert a deadline on this clock to the machine's clock, as of now. Without this, a wait under a clock that is behind would end
 * at once, and its caller would spin. */
static struct timespec to_machine_clock(const struct timespec *wall) {
  int64_t at = nanoseconds(*wall) - wall_now() + machine_now();
  if (at < 0) at = 0;
  return (struct timespec){at / NS, at % NS};
}

/* Look libc's function up by version: on x86-64 the plain name may return the oldest one. Other architectures have only one. */
#define REAL(name, version) \
  static __typeof__(name) *real; \
  if (!real && !(real = (__typeof__(name) *)dlvsym(RTLD_NEXT, #name, version))) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)
#define ON_MONOTONIC_CLOCK 2u /* in a condition variable's __wrefs, of glibc 2.25 and later */

int pthread_cond_timedwait(pthread_cond_t *restrict cond, pthread_mutex_t *restrict mutex, const struct timespec *restrict until) {
  REAL(pthread_cond_timedwait, "GLIBC_2.3.2");
  if (!page || cond->__data.__wrefs & ON_MONOTONIC_CLOCK) return real(cond, mutex, until);
  struct timespec at = to_machine_clock(until);
  return real(cond, mutex, &at);
}

int pthread_cond_clockwait(pthread_cond_t *restrict cond, pthread_mutex_t *restrict mutex, clockid_t id,
                           const struct timespec *restrict until) {
  REAL(pthread_cond_clockwait, "GLIBC_2.34");
  if (!page || id != CLOCK_REALTIME) return real(cond, mutex, id, until);
  struct timespec at = to_machine_clock(until);
  return real(cond, mutex, id, &at);
}

int pthread_mutex_timedlock(pthread_mutex_t *restrict mutex, const struct timespec *restrict until) {
  REAL(pthread_mutex_timedlock, "GLIBC_2.34");
  if (!page) return real(mutex, until);
  struct timespec at = to_machine_clock(until);
  return real(mutex, &at);
}

int sem_timedwait(sem_t *restrict sem, const struct timespec *restrict until) {
  REAL(sem_timedwait, "GLIBC_2.34");
  if (!page) return real(sem, until);
  struct timespec at = to_machine_clock(until);
  return real(sem, &at);
}

int sem_clockwait(sem_t *restrict sem, clockid_t id, const struct timespec *restrict until) {
  REAL(sem_clockwait, "GLIBC_2.34");
  if (!page || id != CLOCK_REALTIME) return real(sem, id, until);
  struct timespec at = to_machine_clock(until);
  return real(sem, id, &at);
}

/* The kernel timestamps packets with the machine's clock, so no program may get these: without them it reads the clock itself. */
int setsockopt(int fd, int level, int name, const void *value, socklen_t size) {
  if (page && level == SOL_SOCKET) {
    if (name == SO_TIMESTAMP_OLD || name == SO_TIMESTAMP_NEW || name == SO_TIMESTAMPNS_OLD || name == SO_TIMESTAMPNS_NEW) return 0;
    if (name == SO_TIMESTAMPING_OLD || name == SO_TIMESTAMPING_NEW) return errno = ENOPROTOOPT, -1;
  }
  return (int)syscall(SYS_setsockopt, fd, level, name, value, size);
}
