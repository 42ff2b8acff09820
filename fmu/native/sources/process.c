/* The controller as the engine of an instance: a Python process at the other end of a socket.
 *
 * resources/controller.json is the controller's, resources/server.py runs it, resources/python.txt names the
 * interpreter; the environment variable SIDESTEP_PYTHON overrides that. One request, one answer, in native byte
 * order: a head of code and size, then as many bytes. The requests that carry all values are answered with all
 * values; an answer whose code is not OK carries the reason as text.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include "instance.h"

enum { START = 1, STEP, SAVE, RESTORE };
enum { START_LIMIT = 300000, STEP_LIMIT = 30000, END_LIMIT = 2000 }; /* [ms] */
enum { CHILD_SOCKET = 3 };

typedef struct {
    int64_t code;
    uint64_t size;
} Head;

typedef struct {
    int socket, errors;
    pid_t child;
    unsigned char *buffer;
    size_t capacity;
    char line[512]; /* what the child wrote last on its error stream */
    size_t length;
} Process;

extern char **environ;

/* Starting it */

static int read_interpreter(const char *folder, char path[], size_t size) {
    const char *override = getenv("SIDESTEP_PYTHON");
    char file[4096];
    if (override && *override) return snprintf(path, size, "%s", override) < (int)size;
    snprintf(file, sizeof file, "%s/python.txt", folder);
    FILE *stream = fopen(file, "r");
    int found = stream && fgets(path, (int)size, stream);
    if (stream) fclose(stream);
    if (found) path[strcspn(path, "\r\n")] = 0;
    return found;
}

/* Path of the resources, from a path (FMI 3.0) or a file URI (FMI 2.0), without a slash at its end. */
static void decode_folder(const char *resources, char folder[], size_t size) {
    int uri = strncmp(resources, "file:", 5) == 0;
    const char *from = resources + (uri ? 5 : 0);
    size_t n = 0;
    if (uri && strncmp(from, "//", 2) == 0) from = strchr(from + 2, '/') ? strchr(from + 2, '/') : from + 2;
    while (*from && n + 1 < size) {
        unsigned code;
        if (uri && from[0] == '%' && sscanf(from + 1, "%2x", &code) == 1) {
            folder[n++] = (char)code;
            from += 3;
        } else {
            folder[n++] = *from++;
        }
    }
    while (n > 1 && folder[n - 1] == '/') n--;
    folder[n] = 0;
}

/* The host's environment but what it set for its own libraries and its own Python. */
static char **clean_environment(void) {
    size_t count = 0, kept = 0;
    while (environ[count]) count++;
    char **clean = malloc((count + 1) * sizeof *clean);
    if (!clean) return NULL;
    for (size_t i = 0; i < count; i++)
        if (strncmp(environ[i], "LD_", 3) && strncmp(environ[i], "PYTHON", 6)) clean[kept++] = environ[i];
    clean[kept] = NULL;
    return clean;
}

static int spawn(Process *process, const char *interpreter, const char *folder, int socket, int errors) {
    char script[4200];
    char *arguments[] = {(char *)interpreter, "-I", script, NULL}, **environment = clean_environment();
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none;
    snprintf(script, sizeof script, "%s/server.py", folder);
    sigemptyset(&none);
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, errors, 1);
    posix_spawn_file_actions_adddup2(&actions, errors, 2);
    posix_spawn_file_actions_adddup2(&actions, socket, CHILD_SOCKET); /* the only one that outlives exec */
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK);
    posix_spawnattr_setpgroup(&attributes, 0); /* the terminal's Ctrl-C is for the host */
    posix_spawnattr_setsigmask(&attributes, &none);
    int failed = environment ? posix_spawn(&process->child, interpreter, &actions, &attributes, arguments, environment)
                             : ENOMEM;
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    free(environment);
    return failed;
}

Status engine_open(Instance *instance, const char *resources) {
    char folder[4096], interpreter[4096];
    int sockets[2] = {-1, -1}, errors[2] = {-1, -1};
    Process *process = calloc(1, sizeof *process);
    if (!process) return report(instance, ERROR, "no memory for the process");
    process->socket = process->errors = -1;
    instance->engine = process;
    decode_folder(resources ? resources : "", folder, sizeof folder);
    if (!read_interpreter(folder, interpreter, sizeof interpreter))
        return report(instance, ERROR, "%s/python.txt cannot be read", folder);
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets)) return report(instance, ERROR, "no socket");
    process->socket = sockets[0];
    if (pipe2(errors, O_CLOEXEC)) {
        close(sockets[1]);
        return report(instance, ERROR, "no pipe");
    }
    process->errors = errors[0];
    fcntl(errors[0], F_SETFL, O_NONBLOCK);
    int failed = spawn(process, interpreter, folder, sockets[1], errors[1]);
    close(sockets[1]);
    close(errors[1]);
    if (!failed) return OK;
    process->child = 0;
    return report(instance, ERROR, "%s cannot be started: %s (set SIDESTEP_PYTHON to a Python that has sidestep)",
                  interpreter, strerror(failed));
}

/* Ending it */

static int wait_for_end(Process *process, int limit) {
    struct timespec millisecond = {0, 1000000};
    int status = 0;
    for (int waited = 0; waited < limit; waited++) {
        pid_t ended = waitpid(process->child, &status, WNOHANG);
        if (ended == process->child || (ended < 0 && errno != EINTR)) return status;
        nanosleep(&millisecond, NULL);
    }
    kill(process->child, SIGKILL);
    while (waitpid(process->child, &status, 0) < 0 && errno == EINTR) {}
    return status;
}

void engine_close(Instance *instance) {
    Process *process = instance->engine;
    if (!process) return;
    if (process->socket >= 0) close(process->socket); /* at which it ends by itself */
    if (process->child > 0) wait_for_end(process, END_LIMIT);
    if (process->errors >= 0) close(process->errors);
    free(process->buffer);
    free(process);
    instance->engine = NULL;
}

/* Talking to it */

/* Hands the child's error stream to the host's logger, line by line. */
static void drain(Instance *instance) {
    Process *process = instance->engine;
    char text[1024];
    ssize_t n;
    while ((n = read(process->errors, text, sizeof text)) > 0)
        for (ssize_t i = 0; i < n; i++) {
            if (text[i] != '\n' && process->length + 1 < sizeof process->line) {
                process->line[process->length++] = text[i];
                continue;
            }
            process->line[process->length] = 0;
            if (process->length) report(instance, WARNING, "%s", process->line);
            process->length = 0;
        }
}

static Status died(Instance *instance, const char *how) {
    Process *process = instance->engine;
    kill(process->child, SIGKILL); /* if it hangs; it cannot be asked any more */
    int status = wait_for_end(process, END_LIMIT);
    process->child = 0;
    drain(instance);
    close(process->socket);
    process->socket = -1;
    if (how) return report(instance, FATAL, "the controller's process %s", how);
    if (WIFEXITED(status)) return report(instance, FATAL, "the controller's process ended: %s (exit status %d)",
                                         process->line, WEXITSTATUS(status));
    return report(instance, FATAL, "the controller's process was killed");
}

static int transmit(int socket, const void *data, size_t size) {
    for (const char *at = data; size;) {
        ssize_t n = send(socket, at, size, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return 0;
        at += n;
        size -= (size_t)n;
    }
    return 1;
}

/* 1 all there, 0 the process is gone, -1 it is silent for too long. */
static int receive(Instance *instance, void *data, size_t size, int limit) {
    Process *process = instance->engine;
    for (char *at = data; size;) {
        struct pollfd ready[] = {{process->socket, POLLIN, 0}, {process->errors, POLLIN, 0}};
        int count = poll(ready, 2, limit);
        if (count < 0 && errno == EINTR) continue;
        if (count == 0) return -1;
        if (ready[1].revents & POLLIN) drain(instance);
        if (!ready[0].revents) continue;
        ssize_t n = recv(process->socket, at, size, 0);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return 0;
        at += n;
        size -= (size_t)n;
    }
    return 1;
}

static int reserve(Process *process, size_t size) {
    if (size <= process->capacity) return 1;
    unsigned char *larger = realloc(process->buffer, size);
    if (!larger) return 0;
    process->buffer = larger;
    process->capacity = size;
    return 1;
}

/* Sends a request; its answer's bytes stand in the buffer, followed by a zero. */
static Status ask(Instance *instance, int64_t code, const void *data, size_t size, size_t *answered) {
    Process *process = instance->engine;
    Head head = {code, size};
    if (process->socket < 0) return report(instance, FATAL, "the controller's process has ended");
    if (!reserve(process, sizeof head + size)) return report(instance, ERROR, "no memory for a request");
    memcpy(process->buffer, &head, sizeof head);
    if (size) memcpy(process->buffer + sizeof head, data, size);
    if (!transmit(process->socket, process->buffer, sizeof head + size)) return died(instance, NULL);
    int limit = code == START ? START_LIMIT : STEP_LIMIT;
    int got = receive(instance, &head, sizeof head, limit);
    if (got == 1 && !reserve(process, head.size + 1)) return died(instance, "sent too much");
    if (got == 1) got = receive(instance, process->buffer, head.size, limit);
    if (got < 1) return died(instance, got ? "hangs: it was ended" : NULL);
    process->buffer[head.size] = 0;
    *answered = head.size;
    return head.code ? report(instance, (Status)head.code, "%s", (char *)process->buffer) : OK;
}

static Status exchange(Instance *instance, int64_t code, const double values[]) {
    Process *process = instance->engine;
    size_t size = 0;
    Status status = ask(instance, code, values, sizeof instance->data.values, &size);
    if (status) return status;
    if (size != sizeof instance->data.values) return died(instance, "speaks another language");
    for (int i = 0; i < N_VARIABLES; i++)
        if (VARIABLES[i].kind == SAMPLED_KIND)
            memcpy(&instance->data.values[i], process->buffer + i * sizeof(double), sizeof(double));
    return OK;
}

/* Before the first step, u(t0) follows every change; later, a sample is held. */
Status engine_refresh(Instance *instance) {
    Data *data = &instance->data;
    if (data->mode == INSTANTIATED) return OK;
    Status status = data->moved ? OK : exchange(instance, START, data->values);
    if (status == OK) data->stale = 0;
    return status;
}

Status engine_step(Instance *instance, double time, double duration) {
    Data *data = &instance->data;
    (void)duration;
    if (!data->moved) return data->stale ? engine_refresh(instance) : OK;
    if (time < data->values[SAMPLE_TIME] + data->values[PERIOD] * (1.0 - 1e-6)) return OK;
    data->stale = 0;
    return exchange(instance, STEP, data->values);
}

Status engine_save(Instance *instance, const void **memory, size_t *size) {
    if (instance->data.mode == INSTANTIATED || (instance->data.stale && !instance->data.moved)) return OK;
    Status status = ask(instance, SAVE, NULL, 0, size);
    *memory = ((Process *)instance->engine)->buffer;
    return status;
}

Status engine_restore(Instance *instance, const void *memory, size_t size) {
    size_t answered;
    return size ? ask(instance, RESTORE, memory, size, &answered) : OK;
}

Status directional_derivative(Instance *instance, const uint32_t unknowns[], size_t n_unknowns,
                              const uint32_t knowns[], size_t n_knowns, const double seed[], double sensitivity[]) {
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)sensitivity;
    return report(instance, ERROR, "the controller has no directional derivatives");
}
