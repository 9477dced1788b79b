// Files that fail: loaded before all libraries, it stands between a process and the system's calls
// that change files of one folder, and lets one of them fail, or the process die there.

#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <mutex>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace {

enum Kind { NONE, NO_SPACE, BROKEN, READ_ONLY, SHORT, CRASH, TORN, LOST };

// What an unsynchronised change has replaced.
struct Change {
    dev_t device;
    ino_t inode;
    int fd;
    off_t offset, size;
    std::vector<char> before;
};

// A change of the names in a directory: ``path`` was created, had the name ``from`` before, or was
// removed; ``kept`` is a second name of the file that it has replaced or that was removed.
struct NameChange {
    dev_t device;
    ino_t inode;
    std::string path, from, kept;
};

std::mutex mutex;
std::string folder;
long count, first, lasting;
int kind;
std::vector<Change> unsynchronised;
std::vector<NameChange> unsynchronised_names;
bool inside[65536];

template <typename Function> Function* real(const char* name) {
    return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

bool is_inside(const char* path) {
    return !folder.empty() && std::strncmp(path, folder.c_str(), folder.size()) == 0;
}

bool tracked(int fd) { return fd >= 0 && fd < 65536 && inside[fd]; }

void keep(int fd, off_t offset, size_t length) {
    struct stat status;
    if (fstat(fd, &status)) return;
    Change change{status.st_dev, status.st_ino, -1, offset, status.st_size, {}};
    change.fd = real<int(int)>("dup")(fd);
    change.before.resize(length);
    ssize_t got = real<ssize_t(int, void*, size_t, off_t)>("pread64")(
        fd, change.before.data(), length, offset);
    change.before.resize(got > 0 ? got : 0);
    unsynchronised.push_back(std::move(change));
}

void synchronised(int fd) {
    struct stat status;
    if (fstat(fd, &status)) return;
    std::vector<Change> left;
    for (auto& change : unsynchronised) {
        if (change.device == status.st_dev && change.inode == status.st_ino)
            real<int(int)>("close")(change.fd);
        else
            left.push_back(std::move(change));
    }
    unsynchronised = std::move(left);
    std::vector<NameChange> names;
    for (auto& change : unsynchronised_names)
        if (change.device != status.st_dev || change.inode != status.st_ino)
            names.push_back(std::move(change));
    unsynchronised_names = std::move(names);
}

int real_rename(const std::string& from, const std::string& to) {
    return real<int(const char*, const char*)>("rename")(from.c_str(), to.c_str());
}

// Notes that a name is about to be changed, and keeps the file that it has now.
void keep_name(const std::string& path, const std::string& from) {
    struct stat status;
    if (stat(path.substr(0, path.rfind('/')).c_str(), &status)) return;
    NameChange change{status.st_dev, status.st_ino, path, from, {}};
    if (!access(path.c_str(), F_OK)) {
        static long kept = 0;
        change.kept = folder + "/.kept_" + std::to_string(kept++);
        if (link(path.c_str(), change.kept.c_str())) change.kept.clear();
    }
    unsynchronised_names.push_back(std::move(change));
}

[[noreturn]] void die() {
    kill(getpid(), SIGKILL);
    for (;;) pause();
}

// As when the power is lost: what was not synchronised is as it was, names of files as well, which
// are synchronised with their directory.
[[noreturn]] void lose() {
    for (auto change = unsynchronised.rbegin(); change != unsynchronised.rend(); ++change) {
        if (!change->before.empty())
            real<ssize_t(int, const void*, size_t, off_t)>("pwrite64")(
                change->fd, change->before.data(), change->before.size(), change->offset);
        if (real<int(int, off_t)>("ftruncate64")(change->fd, change->size)) break;
    }
    for (auto change = unsynchronised_names.rbegin(); change != unsynchronised_names.rend();
         ++change) {
        if (!change->from.empty())
            real_rename(change->path, change->from);
        else if (change->kept.empty())
            real<int(const char*)>("unlink")(change->path.c_str());
        if (!change->kept.empty()) real_rename(change->kept, change->path);
    }
    die();
}

// Returns what is to happen to the next change of a file.
int next() {
    if (kind == NONE) return NONE;
    ++count;
    if (count < first || count >= first + lasting) return NONE;
    if (kind == CRASH) die();
    if (kind == LOST) lose();
    return kind;
}

int error_of(int which) {
    return which == NO_SPACE ? ENOSPC : which == READ_ONLY ? EROFS : EIO;
}

// Whether a call that writes no bytes fails.
bool fails() {
    int now = next();
    if (now == NONE || now == SHORT) return false;
    if (now == TORN) die();
    errno = error_of(now);
    return true;
}

template <typename Write> ssize_t written(int fd, size_t length, off_t offset, Write write) {
    if (!tracked(fd)) return write(length);
    std::lock_guard<std::mutex> lock(mutex);
    int now = next();
    if (now == NO_SPACE || now == BROKEN || now == READ_ONLY) {
        errno = error_of(now);
        return -1;
    }
    if (kind == LOST) keep(fd, offset, length);
    ssize_t done = write(now == SHORT || now == TORN ? (length + 1) / 2 : length);
    if (now == TORN) die();
    return done;
}

int opened(const char* path, int fd) {
    if (fd >= 0 && fd < 65536) inside[fd] = is_inside(path);
    return fd;
}

bool refused(const char* path, int flags) {
    if (!is_inside(path) || !(flags & (O_CREAT | O_WRONLY | O_RDWR))) return false;
    std::lock_guard<std::mutex> lock(mutex);
    if (fails()) return true;
    if (kind == LOST && (flags & O_CREAT) && access(path, F_OK)) keep_name(path, {});
    return false;
}

}  // namespace

extern "C" {

// Lets the changes from the first on fail, so many of them, in the files of a folder.
void faulty_arm(const char* where, int what, long from, long many) {
    std::lock_guard<std::mutex> lock(mutex);
    folder = where;
    kind = what;
    first = from;
    lasting = many;
    count = 0;
}

// Returns whether anything has failed.
int faulty_hit() { return kind != NONE && count >= first; }

// Lets the power be lost now, if it is to be and was not before.
void faulty_end() {
    std::lock_guard<std::mutex> lock(mutex);
    if (kind == LOST) lose();
}

#define OPEN(NAME)                                                            \
    int NAME(const char* path, int flags, ...) {                              \
        va_list rest;                                                         \
        va_start(rest, flags);                                                \
        mode_t mode = va_arg(rest, mode_t);                                   \
        va_end(rest);                                                         \
        if (refused(path, flags)) return -1;                                  \
        return opened(path,                                            \
                      real<int(const char*, int, mode_t)>(#NAME)(path, flags, mode)); \
    }
OPEN(open)
OPEN(open64)

#define OPENAT(NAME)                                                          \
    int NAME(int at, const char* path, int flags, ...) {                      \
        va_list rest;                                                         \
        va_start(rest, flags);                                                \
        mode_t mode = va_arg(rest, mode_t);                                   \
        va_end(rest);                                                         \
        if (refused(path, flags)) return -1;                                  \
        return opened(path,                                            \
                      real<int(int, const char*, int, mode_t)>(#NAME)(at, path, flags, mode)); \
    }
OPENAT(openat)
OPENAT(openat64)

int close(int fd) {
    if (fd >= 0 && fd < 65536) inside[fd] = false;
    return real<int(int)>("close")(fd);
}

ssize_t write(int fd, const void* data, size_t length) {
    off_t offset = tracked(fd) ? lseek(fd, 0, SEEK_CUR) : 0;
    return written(fd, length, offset, [&](size_t part) {
        return real<ssize_t(int, const void*, size_t)>("write")(fd, data, part);
    });
}

#define PWRITE(NAME)                                                          \
    ssize_t NAME(int fd, const void* data, size_t length, off_t offset) {     \
        return written(fd, length, offset, [&](size_t part) {                 \
            return real<ssize_t(int, const void*, size_t, off_t)>(#NAME)(     \
                fd, data, part, offset);                                      \
        });                                                                   \
    }
PWRITE(pwrite)
PWRITE(pwrite64)

#define TRUNCATE(NAME)                                                        \
    int NAME(int fd, off_t size) {                                            \
        if (tracked(fd)) {                                                    \
            std::lock_guard<std::mutex> lock(mutex);                          \
            if (fails()) return -1;                                           \
            struct stat status;                                               \
            if (kind == LOST && !fstat(fd, &status) && status.st_size > size) \
                keep(fd, size, status.st_size - size);                        \
        }                                                                     \
        return real<int(int, off_t)>(#NAME)(fd, size);                        \
    }
TRUNCATE(ftruncate)
TRUNCATE(ftruncate64)

#define SYNC(NAME)                                                            \
    int NAME(int fd) {                                                        \
        if (tracked(fd)) {                                                    \
            std::lock_guard<std::mutex> lock(mutex);                          \
            if (fails()) return -1;                                           \
            if (kind == LOST) synchronised(fd);                               \
        }                                                                     \
        return real<int(int)>(#NAME)(fd);                                     \
    }
SYNC(fsync)
SYNC(fdatasync)

int rename(const char* from, const char* to) {
    if (is_inside(to)) {
        std::lock_guard<std::mutex> lock(mutex);
        if (fails()) return -1;
        if (kind == LOST) keep_name(to, from);
    }
    return real_rename(from, to);
}

int unlink(const char* path) {
    if (is_inside(path) && !access(path, F_OK)) {
        std::lock_guard<std::mutex> lock(mutex);
        if (fails()) return -1;
        if (kind == LOST) keep_name(path, {});
    }
    return real<int(const char*)>("unlink")(path);
}

int mkdir(const char* path, mode_t mode) {
    if (is_inside(path)) {
        std::lock_guard<std::mutex> lock(mutex);
        if (fails()) return -1;
    }
    return real<int(const char*, mode_t)>("mkdir")(path, mode);
}
}
