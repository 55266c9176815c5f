/* Stands between a process and the C library, and sees what it does to one grid file and its journal.

   LD_PRELOADed; until shim_arm() is called it passes everything on. Operations are counted, and at a
   chosen one the process is killed, or the operation fails. What is written may be traced. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

enum { CREATE, WRITE, SYNC, TRUNCATE, UNLINK, READ, MARK, KINDS };   /* as in shim.py */
enum { COUNT, KILL, TEAR, FAIL, SHORTEN };                           /* as in shim.py */
enum { OTHER, GRID, JOURNAL, FOLDER };                               /* as in powercut.py */
enum { FILES = 4096 };

static char grid[4096], journal[4096], folder[4096];
static unsigned char what[FILES]; /* which of the files an open descriptor leads to */
static int armed, action, mask, code, sticky, trace = -1;
static long at, seen;
static volatile int64_t *counts; /* [KINDS], shared with whoever looks on */

static ssize_t (*real_write)(int, const void *, size_t);

#define REAL(name, type, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) *(void **)&real = dlsym(RTLD_NEXT, name)

void shim_arm(const char *path, int do_what, int which, long when, int error, int for_good,
              int trace_fd, int64_t *shared)
{
    size_t end = strlen(path);
    memcpy(grid, path, end + 1);
    memcpy(journal, path, end);
    memcpy(journal + end, "-journal", 9);
    memcpy(folder, path, end + 1);
    *strrchr(folder, '/') = 0;
    action = do_what, mask = which, at = when, code = error, sticky = for_good;
    trace = trace_fd, counts = shared, seen = 0;
    if (!real_write) *(void **)&real_write = dlsym(RTLD_NEXT, "write");
    armed = 1;
}

static void note(int kind, int file, off_t offset, const void *data, size_t size)
{
    if (trace < 0) return;
    int64_t head[4] = {kind, file, offset, (int64_t)size};
    if (real_write(trace, head, sizeof head) < 0 || (data && real_write(trace, data, size) < 0))
        raise(SIGABRT);
}

/* Note that something was reported done, which must now outlast a power cut. */
void shim_mark(void) { if (armed) note(MARK, OTHER, 0, NULL, 0); }

static int which_path(const char *path)
{
    return !armed || !path || path[0] != '/' ? OTHER
        : !strcmp(path, grid) ? GRID : !strcmp(path, journal) ? JOURNAL
        : !strcmp(path, folder) ? FOLDER : OTHER;
}

static int which_file(int fd) { return armed && fd >= 0 && fd < FILES ? what[fd] : OTHER; }

/* Count an operation; 1: it is the one that shall go wrong. */
static int struck(int kind)
{
    counts[kind]++;
    if (!(mask >> kind & 1)) return 0;
    seen++;
    if (action == COUNT || !(seen == at || (sticky && seen > at))) return 0;
    if (action == KILL) raise(SIGKILL);
    return 1;
}

static int failed(void) { errno = code; return -1; }

static int opened(int fd, int file, int created)
{
    if (fd >= 0 && fd < FILES) what[fd] = (unsigned char)file;
    if (fd >= 0 && created) note(CREATE, file, 0, NULL, 0);
    return fd;
}

#define OPEN(name) \
    int name(const char *path, int flags, ...) \
    { \
        REAL(#name, int, const char *, int, ...); \
        int mode = 0; \
        if (flags & (O_CREAT | __O_TMPFILE)) { \
            va_list rest; \
            va_start(rest, flags); \
            mode = va_arg(rest, int); \
            va_end(rest); \
        } \
        int file = which_path(path); \
        int create = file && (flags & O_CREAT) && access(path, F_OK); \
        if (create && struck(CREATE)) return failed(); \
        return opened(real(path, flags, mode), file, create); \
    }
OPEN(open)
OPEN(open64)

int close(int fd)
{
    REAL("close", int, int);
    if (fd >= 0 && fd < FILES) what[fd] = OTHER;
    return real(fd);
}

#define PWRITE(name, type) \
    ssize_t name(int fd, const void *data, size_t size, type offset) \
    { \
        REAL(#name, ssize_t, int, const void *, size_t, type); \
        int file = which_file(fd); \
        if (file && struck(WRITE)) { \
            if (action == FAIL) return failed(); \
            size_t part = size / 2 ? size / 2 : 1; \
            if (action == TEAR) { real(fd, data, part, offset); raise(SIGKILL); } \
            size = part; \
        } \
        ssize_t done = real(fd, data, size, offset); \
        if (file && done > 0) note(WRITE, file, offset, data, (size_t)done); \
        return done; \
    }
PWRITE(pwrite, off_t)
PWRITE(pwrite64, off64_t)

ssize_t write(int fd, const void *data, size_t size)
{
    REAL("write", ssize_t, int, const void *, size_t);
    int file = which_file(fd);
    if (!file) return real(fd, data, size);
    off_t offset = lseek(fd, 0, SEEK_CUR);
    return pwrite(fd, data, size, offset) < 0 ? -1 : (lseek(fd, offset + (off_t)size, SEEK_SET), (ssize_t)size);
}

#define PREAD(name, type) \
    ssize_t name(int fd, void *data, size_t size, type offset) \
    { \
        REAL(#name, ssize_t, int, void *, size_t, type); \
        if (which_file(fd) && struck(READ)) return failed(); \
        return real(fd, data, size, offset); \
    }
PREAD(pread, off_t)
PREAD(pread64, off64_t)

ssize_t read(int fd, void *data, size_t size)
{
    REAL("read", ssize_t, int, void *, size_t);
    if (which_file(fd) && struck(READ)) return failed();
    return real(fd, data, size);
}

#define FLUSH(name) \
    int name(int fd) \
    { \
        REAL(#name, int, int); \
        int file = which_file(fd); \
        if (file && struck(SYNC)) return failed(); \
        int done = real(fd); \
        if (file && !done) note(SYNC, file, 0, NULL, 0); \
        return done; \
    }
FLUSH(fsync)
FLUSH(fdatasync)

#define CUT(name, type) \
    int name(int fd, type size) \
    { \
        REAL(#name, int, int, type); \
        int file = which_file(fd); \
        if (file && struck(TRUNCATE)) return failed(); \
        int done = real(fd, size); \
        if (file && !done) note(TRUNCATE, file, size, NULL, 0); \
        return done; \
    }
CUT(ftruncate, off_t)
CUT(ftruncate64, off64_t)

int unlink(const char *path)
{
    REAL("unlink", int, const char *);
    int file = which_path(path);
    if (file && struck(UNLINK)) return failed();
    int done = real(path);
    if (file && !done) note(UNLINK, file, 0, NULL, 0);
    return done;
}
