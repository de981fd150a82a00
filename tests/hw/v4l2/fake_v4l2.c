/* Plays V4L2 capture devices for one process: preload it, so that the real v4l2src runs.
 *
 * Every file $TAMS_FAKE_V4L2/video* is a camera, described by the struct camera in it, which the
 * test shares with us: it says how the camera behaves and reads what was done to it. A camera is
 * unplugged by removing its file. File descriptors are eventfds, readable when a frame is ready.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { MAX_OPEN = 32, MAX_BUFFERS = 16, MAX_CONTROLS = 8, OFFSET_STEP = 1 << 22 };
enum behaviour { RUNS, SILENT, MARKS };

struct control {
    uint32_t id, type;
    char name[32];
    int32_t minimum, maximum, step, fallback, value;
    uint32_t stubborn; /* takes any value and keeps its own */
    uint32_t flags;
};

struct camera {
    char card[32];
    uint32_t behaviour, metadata, pixelformat, width, height;
    uint32_t rate, period;     /* frames in so many seconds */
    uint32_t widest, highest;  /* of any size from the one above on, 0: it has that one alone */
    uint32_t slowest;          /* of any rate up to the one above, 0: it has that one alone */
    uint32_t open_error;       /* why it cannot be opened, 0: it can */
    uint32_t age_us;                            /* of a frame when it is ready */
    uint32_t changes, streams_started;          /* what was done */
    uint32_t frame_bytes, frame_count; /* the JPEGs behind this struct, each this long */
    uint32_t control_count;
    struct control controls[MAX_CONTROLS];
};

struct opened {
    int fd, twin; /* the eventfd, and its duplicate, or -1 */
    char path[256];
    struct camera *camera;
    size_t mapped;
    int streaming;
    pthread_t thread;
    void *buffers[MAX_BUFFERS];
    struct v4l2_buffer states[MAX_BUFFERS];
    int count, queued[MAX_BUFFERS], queued_count, ready[MAX_BUFFERS], ready_count;
    uint32_t sequence;
};

static struct opened table[MAX_OPEN];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static int is_ours(const char *path) {
    const char *root = getenv("TAMS_FAKE_V4L2");
    size_t length = root ? strlen(root) : 0;
    return length && !strncmp(path, root, length) && !strncmp(path + length, "/video", 6);
}

static struct opened *find(int fd) {
    for (int i = 0; fd >= 0 && i < MAX_OPEN; i++)
        if (table[i].camera && (table[i].fd == fd || table[i].twin == fd)) return &table[i];
    return NULL;
}

static int plugged(struct opened *o) { return access(o->path, F_OK) == 0; }
static size_t picture_bytes(struct camera *c) {
    return c->pixelformat == V4L2_PIX_FMT_MJPEG ? c->frame_bytes : c->width * c->height * 2;
}

static int take(int *queue, int *count) {
    int first = queue[0];
    memmove(queue, queue + 1, --*count * sizeof *queue);
    return first;
}

/* The time is when the frame was due: a kernel takes it as the data arrives, however busy we are. */
static void fill(struct opened *o, int index, const struct timespec *due) {
    struct camera *c = o->camera;
    size_t bytes = picture_bytes(c);
    uint32_t number = o->sequence;
    unsigned char *frame = o->buffers[index];
    if (c->pixelformat == V4L2_PIX_FMT_MJPEG)
        memcpy(frame, (char *)(c + 1) + bytes * (number % c->frame_count), bytes);
    else
        for (size_t i = 0; i < bytes; i++) frame[i] = (i + number * 7) & 0xff;
    int64_t us = due->tv_sec * 1000000LL + due->tv_nsec / 1000 - c->age_us;
    struct v4l2_buffer *state = &o->states[index];
    state->timestamp.tv_sec = us / 1000000;
    state->timestamp.tv_usec = us % 1000000;
    state->sequence = o->sequence;
    state->bytesused = bytes;
    state->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_DONE;
    if (c->behaviour == MARKS && number % 2) state->flags |= V4L2_BUF_FLAG_ERROR;
}

static void *film(void *argument) {
    struct opened *o = argument;
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (;;) {
        due.tv_nsec += 1000000000LL * o->camera->period / o->camera->rate;
        if (due.tv_nsec >= 1000000000) due.tv_sec++, due.tv_nsec -= 1000000000;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        pthread_mutex_lock(&lock);
        int go_on = o->streaming && plugged(o);
        o->sequence++;
        if (go_on && o->camera->behaviour != SILENT && o->queued_count) {
            int index = take(o->queued, &o->queued_count);
            fill(o, index, &due);
            o->ready[o->ready_count++] = index;
            eventfd_write(o->fd, 1);
        } else if (o->streaming && !plugged(o)) {
            eventfd_write(o->fd, 1); /* wakes the waiting thread: there is an error to fetch */
        }
        pthread_mutex_unlock(&lock);
        if (!go_on) return NULL;
    }
}

static void stop(struct opened *o) {
    if (!o->streaming) return;
    o->streaming = 0;
    pthread_mutex_unlock(&lock);
    pthread_join(o->thread, NULL);
    pthread_mutex_lock(&lock);
    eventfd_t ignored;
    for (; o->ready_count; o->ready_count--) eventfd_read(o->fd, &ignored);
    o->queued_count = 0;
}

static int start(struct opened *o) {
    o->streaming = 1;
    o->sequence = 0;
    o->camera->streams_started++;
    return pthread_create(&o->thread, NULL, film, o);
}

/* --- the questions ----------------------------------------------------------------------------- */

static int refuse(int error) {
    errno = error;
    return -1;
}

static int busy(struct opened *o) {
    for (int i = 0; i < MAX_OPEN; i++)
        if (&table[i] != o && table[i].camera && table[i].streaming &&
            !strcmp(table[i].path, o->path))
            return 1;
    return 0;
}

static int capability(struct opened *o, struct v4l2_capability *a) {
    memset(a, 0, sizeof *a);
    strcpy((char *)a->driver, "uvcvideo");
    memcpy(a->card, o->camera->card, sizeof a->card);
    strcpy((char *)a->bus_info, "usb-0000:00:14.0-1");
    a->device_caps = V4L2_CAP_STREAMING |
                     (o->camera->metadata ? V4L2_CAP_META_CAPTURE : V4L2_CAP_VIDEO_CAPTURE);
    a->capabilities = V4L2_CAP_DEVICE_CAPS | V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
    return 0;
}

static int formats(struct camera *c, struct v4l2_fmtdesc *a) {
    if (a->index || a->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return refuse(EINVAL);
    a->flags = c->pixelformat == V4L2_PIX_FMT_MJPEG ? V4L2_FMT_FLAG_COMPRESSED : 0;
    a->pixelformat = c->pixelformat;
    strcpy((char *)a->description, "fake");
    return 0;
}

static int sizes(struct camera *c, struct v4l2_frmsizeenum *a) {
    if (a->index || a->pixel_format != c->pixelformat) return refuse(EINVAL);
    if (c->widest) {
        a->type = V4L2_FRMSIZE_TYPE_STEPWISE;
        a->stepwise = (struct v4l2_frmsize_stepwise){c->width, c->widest, 2, c->height, c->highest, 2};
    } else {
        a->type = V4L2_FRMSIZE_TYPE_DISCRETE;
        a->discrete = (struct v4l2_frmsize_discrete){c->width, c->height};
    }
    return 0;
}

static int intervals(struct camera *c, struct v4l2_frmivalenum *a) {
    uint32_t widest = c->widest ? c->widest : c->width;
    uint32_t highest = c->highest ? c->highest : c->height;
    if (a->index || a->width < c->width || a->width > widest) return refuse(EINVAL);
    if (a->height < c->height || a->height > highest) return refuse(EINVAL);
    struct v4l2_fract fastest = {c->period, c->rate};
    if (c->slowest) {
        a->type = V4L2_FRMIVAL_TYPE_CONTINUOUS;
        a->stepwise = (struct v4l2_frmival_stepwise){fastest, {1, c->slowest}, {1, 1}};
    } else {
        a->type = V4L2_FRMIVAL_TYPE_DISCRETE;
        a->discrete = fastest;
    }
    return 0;
}

static int format(struct camera *c, struct v4l2_format *a) {
    if (a->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return refuse(EINVAL);
    memset(&a->fmt, 0, sizeof a->fmt);
    a->fmt.pix.width = c->width;
    a->fmt.pix.height = c->height;
    a->fmt.pix.pixelformat = c->pixelformat;
    a->fmt.pix.field = V4L2_FIELD_NONE;
    a->fmt.pix.bytesperline = c->pixelformat == V4L2_PIX_FMT_MJPEG ? 0 : c->width * 2;
    a->fmt.pix.sizeimage = picture_bytes(c);
    a->fmt.pix.colorspace = V4L2_COLORSPACE_SRGB;
    return 0;
}

static int rate(struct camera *c, struct v4l2_streamparm *a) {
    if (a->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return refuse(EINVAL);
    memset(&a->parm, 0, sizeof a->parm);
    a->parm.capture.capability = V4L2_CAP_TIMEPERFRAME;
    a->parm.capture.timeperframe.numerator = c->period;
    a->parm.capture.timeperframe.denominator = c->rate;
    return 0;
}

static int request(struct opened *o, struct v4l2_requestbuffers *a) {
    if (a->memory != V4L2_MEMORY_MMAP) return refuse(EINVAL);
    if (busy(o)) return refuse(EBUSY);
    if (a->count > MAX_BUFFERS) a->count = MAX_BUFFERS;
    o->count = a->count;
    o->queued_count = 0;
    a->capabilities = V4L2_BUF_CAP_SUPPORTS_MMAP;
    for (unsigned i = 0; i < a->count; i++) {
        struct v4l2_buffer state = {.index = i, .type = a->type, .memory = V4L2_MEMORY_MMAP};
        state.length = picture_bytes(o->camera);
        state.m.offset = i * OFFSET_STEP;
        o->states[i] = state;
    }
    return 0;
}

static int look_at(struct opened *o, struct v4l2_buffer *a) {
    if ((int)a->index >= o->count) return refuse(EINVAL);
    *a = o->states[a->index];
    return 0;
}

static int queue(struct opened *o, struct v4l2_buffer *a) {
    if ((int)a->index >= o->count) return refuse(EINVAL);
    o->states[a->index].flags = V4L2_BUF_FLAG_QUEUED;
    o->queued[o->queued_count++] = a->index;
    *a = o->states[a->index];
    return 0;
}

static int dequeue(struct opened *o, struct v4l2_buffer *a) {
    if (!o->ready_count) return refuse(EAGAIN);
    eventfd_t ignored;
    eventfd_read(o->fd, &ignored);
    *a = o->states[take(o->ready, &o->ready_count)];
    return 0;
}

static struct control *control_of(struct camera *c, uint32_t id) {
    struct control *next = NULL;
    int wants_next = (id & V4L2_CTRL_FLAG_NEXT_CTRL) != 0;
    for (uint32_t i = 0; i < c->control_count; i++) {
        struct control *found = &c->controls[i];
        if (!wants_next && found->id == id) return found;
        if (found->type >= V4L2_CTRL_COMPOUND_TYPES && !(id & V4L2_CTRL_FLAG_NEXT_COMPOUND)) continue;
        if (wants_next && found->id > (id & V4L2_CTRL_ID_MASK) && (!next || found->id < next->id))
            next = found;
    }
    return next;
}

static int describe_control(struct camera *c, struct v4l2_queryctrl *a) {
    struct control *found = control_of(c, a->id);
    if (!found) return refuse(EINVAL);
    memset(a, 0, sizeof *a);
    a->id = found->id;
    a->type = found->type;
    memcpy(a->name, found->name, sizeof a->name);
    a->minimum = found->minimum;
    a->maximum = found->maximum;
    a->step = found->step;
    a->default_value = found->fallback;
    a->flags = found->flags;
    return 0;
}

static int describe_any_control(struct camera *c, struct v4l2_query_ext_ctrl *a) {
    struct v4l2_queryctrl found = {.id = a->id};
    if (describe_control(c, &found)) return -1;
    memset(a, 0, sizeof *a);
    a->id = found.id;
    a->type = found.type;
    memcpy(a->name, found.name, sizeof a->name);
    a->minimum = found.minimum;
    a->maximum = found.maximum;
    a->step = found.step;
    a->default_value = found.default_value;
    a->flags = found.flags;
    a->elem_size = 4;
    a->elems = 1;
    return 0;
}

static int use_control(struct camera *c, struct v4l2_control *a, int set) {
    struct control *found = control_of(c, a->id);
    if (!found) return refuse(EINVAL);
    if (set && (a->value < found->minimum || a->value > found->maximum)) return refuse(ERANGE);
    if (set && !found->stubborn) found->value = a->value;
    a->value = found->value;
    return 0;
}

static int changes(unsigned long number) {
    switch (number) {
    case VIDIOC_S_FMT: case VIDIOC_S_PARM: case VIDIOC_S_CTRL: case VIDIOC_S_EXT_CTRLS:
    case VIDIOC_S_INPUT: case VIDIOC_S_STD: case VIDIOC_S_PRIORITY: case VIDIOC_S_SELECTION:
    case VIDIOC_REQBUFS: case VIDIOC_STREAMON: case VIDIOC_STREAMOFF: return 1;
    default: return 0;
    }
}

static int answer(struct opened *o, unsigned long number, void *a) {
    struct camera *c = o->camera;
    if (!plugged(o)) return refuse(ENODEV);
    c->changes += changes(number);
    switch (number) {
    case VIDIOC_QUERYCAP: return capability(o, a);
    case VIDIOC_ENUM_FMT: return formats(c, a);
    case VIDIOC_ENUM_FRAMESIZES: return sizes(c, a);
    case VIDIOC_ENUM_FRAMEINTERVALS: return intervals(c, a);
    case VIDIOC_S_FMT: if (busy(o)) return refuse(EBUSY); /* fall through */
    case VIDIOC_G_FMT: case VIDIOC_TRY_FMT: return format(c, a);
    case VIDIOC_G_PARM: case VIDIOC_S_PARM: return rate(c, a);
    case VIDIOC_REQBUFS: return request(o, a);
    case VIDIOC_QUERYBUF: return look_at(o, a);
    case VIDIOC_QBUF: return queue(o, a);
    case VIDIOC_DQBUF: return dequeue(o, a);
    case VIDIOC_STREAMON: return busy(o) ? refuse(EBUSY) : start(o);
    case VIDIOC_STREAMOFF: stop(o); return 0;
    case VIDIOC_QUERYCTRL: return describe_control(c, a);
    case VIDIOC_QUERY_EXT_CTRL: return describe_any_control(c, a);
    case VIDIOC_G_CTRL: return use_control(c, a, 0);
    case VIDIOC_S_CTRL: return use_control(c, a, 1);
    default: return refuse(ENOTTY);
    }
}

/* --- the calls we stand in for ------------------------------------------------------------------ */

static int open_camera(const char *path) {
    int file = REAL(open64)(path, O_RDWR | O_CLOEXEC);
    if (file < 0) return -1;
    struct stat about;
    fstat(file, &about);
    struct camera *camera = mmap(NULL, about.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    REAL(close)(file);
    if (camera->open_error) {
        errno = camera->open_error;
        munmap(camera, about.st_size);
        return -1;
    }
    pthread_mutex_lock(&lock);
    int fd = -1;
    for (int i = 0; i < MAX_OPEN && fd < 0; i++) {
        if (table[i].camera) continue;
        fd = eventfd(0, EFD_NONBLOCK | EFD_SEMAPHORE | EFD_CLOEXEC);
        table[i] = (struct opened){.fd = fd, .twin = -1, .camera = camera, .mapped = about.st_size};
        strncpy(table[i].path, path, sizeof table[i].path - 1);
    }
    pthread_mutex_unlock(&lock);
    return fd;
}

static int open_either(const char *name, const char *path, int flags, mode_t mode) {
    if (is_ours(path)) return open_camera(path);
    return ((int (*)(const char *, int, ...))dlsym(RTLD_NEXT, name))(path, flags, mode);
}

int open64(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    return open_either("open64", path, flags, mode);
}

int open(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    return open_either("open", path, flags, mode);
}

int stat64(const char *path, struct stat64 *about) {
    int result = REAL(stat64)(path, about);
    if (!result && is_ours(path)) about->st_mode = S_IFCHR | 0666;
    return result;
}

int dup(int fd) {
    int copy = REAL(dup)(fd);
    pthread_mutex_lock(&lock);
    struct opened *o = find(fd);
    if (o) o->twin = copy;
    pthread_mutex_unlock(&lock);
    return copy;
}

int close(int fd) {
    pthread_mutex_lock(&lock);
    struct opened *o = find(fd);
    if (o && o->twin >= 0) {
        o->fd = o->fd == fd ? o->twin : o->fd;
        o->twin = -1;
    } else if (o) {
        stop(o);
        munmap(o->camera, o->mapped);
        o->camera = NULL;
    }
    pthread_mutex_unlock(&lock);
    return REAL(close)(fd);
}

int ioctl(int fd, unsigned long number, ...) {
    va_list rest;
    va_start(rest, number);
    void *argument = va_arg(rest, void *);
    va_end(rest);
    pthread_mutex_lock(&lock);
    struct opened *o = find(fd);
    int result = o ? answer(o, number & 0xffffffff, argument) : 0;
    pthread_mutex_unlock(&lock);
    return o ? result : REAL(ioctl)(fd, number, argument);
}

void *mmap64(void *wish, size_t length, int protection, int flags, int fd, off64_t offset) {
    pthread_mutex_lock(&lock);
    struct opened *o = find(fd);
    pthread_mutex_unlock(&lock);
    if (!o) return REAL(mmap64)(wish, length, protection, flags, fd, offset);
    void *memory = REAL(mmap64)(NULL, length, protection, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    o->buffers[offset / OFFSET_STEP] = memory;
    return memory;
}
