/* Faults on demand, by LD_PRELOAD: LMC_FAULT=WHAT:N[:ERRNO] lets the N-th call of WHAT fail, counted from main on.
 *   pwrite fsync rename close   of files that the program writes (their temporary name ends in .part): fail with ERRNO
 *   short eintr                 every pwrite writes half, or is interrupted before it writes
 *   read                        of a level's files: fails with ERRNO; with ERRNO 0 the file has ended there
 *   halfread eintrread          every read of a level's files reads half, or is interrupted before it reads
 *   shrunk grown                a level's files have fewer bytes than fstat said, or more
 *   malloc                      returns nothing, once
 * With LMC_FAULT_COUNT=FILE the number of calls of WHAT is written there at the end (N = 0: none fails). With LMC_OPENED=FILE the path of
 * every file that is opened from main on, links followed, is written there, a line each. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

enum What { NOTHING, PWRITE, FSYNC, RENAME, CLOSE, SHORT, EINTR_, MALLOC, READ, HALFREAD, EINTRREAD, SHRUNK, GROWN, WHATS };
static const char* const names[WHATS] = {"",      "pwrite", "fsync", "rename",   "close",     "short",  "eintr",
                                         "malloc", "read",   "halfread", "eintrread", "shrunk", "grown"};
static enum What what = NOTHING;
static long wanted = 0;
static int failure = EIO;
static atomic_long calls;
static atomic_int counting;
static atomic_int last_interrupted;
static atomic_char ours[1024], inputs[1024];

static int hits(enum What w) {
  if (!atomic_load(&counting) || what != w) return 0;
  return atomic_fetch_add(&calls, 1) + 1 == wanted;
}
static int isOurs(int fd) { return fd >= 0 && fd < 1024 && ours[fd]; }
static int isInput(int fd) { return fd >= 0 && fd < 1024 && inputs[fd]; }
static int endsWith(const char* path, const char* end) {
  const size_t n = strlen(path), m = strlen(end);
  return n > m && strcmp(path + n - m, end) == 0;
}

static void note(void) {
  const char* file = getenv("LMC_FAULT_COUNT");
  if (!file) return;
  atomic_store(&counting, 0);
  FILE* f = fopen(file, "w");
  if (f) fprintf(f, "%ld\n", atomic_load(&calls)), fclose(f);
}

static int openedList = -1;
static void noteOpened(int folder, const char* path) {
  if (!atomic_load(&counting) || openedList < 0) return;
  char beside[64] = "", whole[2 * PATH_MAX], real[PATH_MAX];
  if (folder != AT_FDCWD && path[0] != '/') snprintf(beside, sizeof beside, "/proc/self/fd/%d/", folder);
  snprintf(whole, sizeof whole, "%s%s", beside, path);
  if (realpath(whole, real)) dprintf(openedList, "%s\n", real);  // what is not there is not opened
}

static int (*realMain)(int, char**, char**);
static int countedMain(int argc, char** argv, char** environment) {
  const char* fault = getenv("LMC_FAULT");
  char name[16] = "";
  if (fault && sscanf(fault, "%15[a-z]:%ld:%d", name, &wanted, &failure) >= 1)
    for (int i = 1; i < WHATS; ++i)
      if (strcmp(name, names[i]) == 0) what = (enum What)i;
  atexit(note);
  if (getenv("LMC_OPENED")) openedList = (int)syscall(SYS_openat, AT_FDCWD, getenv("LMC_OPENED"), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  atomic_store(&counting, 1);
  return realMain(argc, argv, environment);
}
int __libc_start_main(int (*main)(int, char**, char**), int argc, char** argv, void (*init)(void), void (*fini)(void), void (*rtld)(void), void* stack) {
  int (*real)(int (*)(int, char**, char**), int, char**, void (*)(void), void (*)(void), void (*)(void), void*) = dlsym(RTLD_NEXT, "__libc_start_main");
  realMain = main;
  return real(countedMain, argc, argv, init, fini, rtld, stack);
}

int open(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) ? va_arg(list, mode_t) : 0;
  va_end(list);
  static int (*real)(const char*, int, ...);
  if (!real) real = dlsym(RTLD_NEXT, "open");
  noteOpened(AT_FDCWD, path);
  const int fd = real(path, flags, mode);
  if (fd >= 0 && fd < 1024) {
    ours[fd] = (flags & O_CREAT) && endsWith(path, ".part");
    inputs[fd] = (flags & O_ACCMODE) == O_RDONLY && (endsWith(path, ".gltf") || endsWith(path, ".glb") || endsWith(path, ".bin") || endsWith(path, ".png"));
  }
  return fd;
}

int openat(int folder, const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) ? va_arg(list, mode_t) : 0;
  va_end(list);
  static int (*real)(int, const char*, int, ...);
  if (!real) real = dlsym(RTLD_NEXT, "openat");
  noteOpened(folder, path);
  return real(folder, path, flags, mode);
}
/* Streams of C and C++. */
FILE* fopen(const char* path, const char* mode) {
  static FILE* (*real)(const char*, const char*);
  if (!real) real = dlsym(RTLD_NEXT, "fopen");
  noteOpened(AT_FDCWD, path);
  return real(path, mode);
}
FILE* fopen64(const char* path, const char* mode) {
  static FILE* (*real)(const char*, const char*);
  if (!real) real = dlsym(RTLD_NEXT, "fopen64");
  noteOpened(AT_FDCWD, path);
  return real(path, mode);
}

static ssize_t write_at(ssize_t (*real)(int, const void*, size_t, off_t), int fd, const void* data, size_t size, off_t at) {
  if (isOurs(fd)) {
    if (hits(PWRITE)) return errno = failure, -1;
    if (what == SHORT && size > 1) size = size / 2 + 1;
    if (what == EINTR_ && !atomic_fetch_xor(&last_interrupted, 1)) return errno = EINTR, -1;
  }
  return real(fd, data, size, at);
}
ssize_t pwrite(int fd, const void* data, size_t size, off_t at) {
  static ssize_t (*real)(int, const void*, size_t, off_t);
  if (!real) real = dlsym(RTLD_NEXT, "pwrite");
  return write_at(real, fd, data, size, at);
}
ssize_t pwrite64(int fd, const void* data, size_t size, off_t at) {
  static ssize_t (*real)(int, const void*, size_t, off_t);
  if (!real) real = dlsym(RTLD_NEXT, "pwrite64");
  return write_at(real, fd, data, size, at);
}
ssize_t read(int fd, void* data, size_t size) {
  static ssize_t (*real)(int, void*, size_t);
  if (!real) real = dlsym(RTLD_NEXT, "read");
  if (isInput(fd)) {
    if (hits(READ)) return failure ? (errno = failure, -1) : 0;
    if (what == HALFREAD && size > 1) size = size / 2 + 1;
    if (what == EINTRREAD && !atomic_fetch_xor(&last_interrupted, 1)) return errno = EINTR, -1;
  }
  return real(fd, data, size);
}
int fstat(int fd, struct stat* info) {
  static int (*real)(int, struct stat*);
  if (!real) real = dlsym(RTLD_NEXT, "fstat");
  const int result = real(fd, info);
  if (result == 0 && isInput(fd) && what == SHRUNK) info->st_size += 4096;
  if (result == 0 && isInput(fd) && what == GROWN) info->st_size = info->st_size * 3 / 4;
  return result;
}
int fsync(int fd) {
  static int (*real)(int);
  if (!real) real = dlsym(RTLD_NEXT, "fsync");
  if (isOurs(fd) && hits(FSYNC)) return errno = failure, -1;
  return real(fd);
}
int rename(const char* from, const char* to) {
  static int (*real)(const char*, const char*);
  if (!real) real = dlsym(RTLD_NEXT, "rename");
  if (hits(RENAME)) return errno = failure, -1;
  return real(from, to);
}
int dup(int fd) {
  static int (*real)(int);
  if (!real) real = dlsym(RTLD_NEXT, "dup");
  const int copy = real(fd);
  if (copy >= 0 && copy < 1024) ours[copy] = isOurs(fd);
  return copy;
}
int close(int fd) {
  static int (*real)(int);
  if (!real) real = dlsym(RTLD_NEXT, "close");
  const int fails = isOurs(fd) && hits(CLOSE);
  if (fd >= 0 && fd < 1024) inputs[fd] = 0;
  const int result = real(fd);
  return fails ? (errno = failure, -1) : result;
}

extern void* __libc_malloc(size_t);
void* malloc(size_t size) {
  if (what == MALLOC && hits(MALLOC)) return errno = ENOMEM, NULL;
  return __libc_malloc(size);
}
