/* The C interface: an instance is one block of memory that holds its records, its road and its arena. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "arena.h"
#include "layout.h"

enum { ARENA_SIZE = 4096 * 1024, LINE = 64, COLUMNS = 6 }; /* columns of the road's table */

/* Compiled from Python, see entries.py. */
int64_t sidestep_kernel_step(sidestep_memory *, sidestep_settings *, double *table, int64_t rows, double period,
                             double *boxes, int64_t count, sidestep_state *, sidestep_work *);
int64_t sidestep_kernel_tune(sidestep_memory *, sidestep_settings *, sidestep_setup *, sidestep_parameters *);
double sidestep_kernel_clearance(sidestep_setup *, double *table, int64_t rows, double *boxes, int64_t count,
                                 sidestep_state *);

struct sidestep {
    sidestep_memory memory, before;
    sidestep_settings settings;
    sidestep_parameters parameters;
    sidestep_setup setup;
    sidestep_state state;
    sidestep_work work;
    double boxes[SIDESTEP_MOST_OBSTACLES][BOX_FIELDS];
    Arena arena;
    double *table;
    void *block;
    size_t size;
};

typedef struct {
    char magic[8];
    uint32_t abi, checksum;
    uint64_t size;
} SetupHeader;

typedef struct { /* as in memory.py */
    char name[8];
    uint32_t version, checksum;
    uint64_t size;
} MemoryHeader;

static const char MAGIC[8] = "sidesetp", NAME[8] = "sidestep";

/* The CRC of zlib. */
static uint32_t checksum(const void *data, size_t size) {
    static const uint32_t HALF[16] = {
        0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
        0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    uint32_t sum = 0xffffffffu;
    for (const unsigned char *at = data, *end = at + size; at < end; at++) {
        sum = HALF[(sum ^ *at) & 15] ^ (sum >> 4);
        sum = HALF[(sum ^ (*at >> 4)) & 15] ^ (sum >> 4);
    }
    return ~sum;
}

uint32_t sidestep_abi(void) { return SIDESTEP_ABI; }

static const char *check_setup(const void *data, size_t size, size_t *rows) {
    SetupHeader head;
    if (size < sizeof head + sizeof(sidestep_setup)) return "the setup is too short";
    memcpy(&head, data, sizeof head);
    const char *body = (const char *)data + sizeof head;
    if (memcmp(head.magic, MAGIC, sizeof MAGIC)) return "this is not a setup";
    if (head.abi != SIDESTEP_ABI) return "the setup is of another version of sidestep: export it again";
    if (head.size != size - sizeof head) return "the setup's length is wrong";
    if (head.checksum != checksum(body, (size_t)head.size)) return "the setup is damaged: its checksum is wrong";
    *rows = ((size_t)head.size - sizeof(sidestep_setup)) / (COLUMNS * sizeof(double));
    return NULL;
}

static size_t padded(size_t size) { return (size + LINE - 1) & ~(size_t)(LINE - 1); }

sidestep *sidestep_create(const void *setup, size_t size, const char **problem) {
    size_t rows = 0;
    const char *ignored;
    if (!problem) problem = &ignored;
    if ((*problem = check_setup(setup, size, &rows))) return NULL;
    size_t own = padded(sizeof(struct sidestep)), road = padded(rows * COLUMNS * sizeof(double));
    unsigned char *block = calloc(1, own + road + ARENA_SIZE + LINE);
    if (!block) {
        *problem = "no memory for a controller";
        return NULL;
    }
    unsigned char *at = (unsigned char *)(((uintptr_t)block + LINE - 1) & ~(uintptr_t)(LINE - 1));
    sidestep *c = (sidestep *)(void *)at;
    const char *body = (const char *)setup + sizeof(SetupHeader);
    c->block = block;
    c->size = own + road + ARENA_SIZE + LINE;
    c->table = (double *)(void *)(at + own);
    c->arena.base = at + own + road;
    c->arena.size = ARENA_SIZE;
    memcpy(&c->setup, body, sizeof c->setup);
    memcpy(c->table, body + sizeof c->setup, rows * COLUMNS * sizeof(double));
    if (c->setup.rows != (int64_t)rows) {
        *problem = "the setup's road is not as long as it says";
        sidestep_free(c);
        return NULL;
    }
    c->settings = c->setup.settings;
    c->parameters = c->setup.parameters;
    sidestep_reset(c);
    return c;
}

void sidestep_free(sidestep *c) {
    if (c) free(c->block);
}

static void tune(sidestep *c) {
    arena_enter(&c->arena);
    sidestep_kernel_tune(&c->memory, &c->settings, &c->setup, &c->parameters);
    arena_enter(NULL);
}

void sidestep_reset(sidestep *c) {
    c->memory = c->setup.memory;
    tune(c);
}

/* Obstacles as they stood at time 0; 0 if one cannot be. */
static int take_obstacles(sidestep *c, const sidestep_obstacle obstacles[], size_t count) {
    for (size_t i = 0; i < count; i++) {
        const sidestep_obstacle *o = &obstacles[i];
        double values[BOX_FIELDS] = {o->s - o->speed * o->time, o->l, o->length, o->width, o->heading, o->speed};
        for (int k = 0; k < BOX_FIELDS; k++) {
            double judged = k ? values[k] : o->s;
            if (!(judged >= BOX_BOUNDS[k][0] && judged <= BOX_BOUNDS[k][1])) return 0;
            c->boxes[i][k] = values[k];
        }
        if (!isfinite(values[0])) return 0;
    }
    return 1;
}

static int run(sidestep *c, size_t count) {
    arena_enter(&c->arena);
    sidestep_kernel_step(&c->memory, &c->settings, c->table, c->setup.rows, c->setup.period, &c->boxes[0][0],
                         (int64_t)count, &c->state, &c->work);
    arena_enter(NULL);
    return !c->arena.failed;
}

/* As for a state that cannot be used: the last good plan is followed. */
static void fall_back(sidestep *c) {
    c->state.time = NAN;
    run(c, 0);
}

int sidestep_step(sidestep *c, const sidestep_state *state, const sidestep_obstacle obstacles[], size_t count,
                  sidestep_command *command) {
    int result = count > SIDESTEP_MOST_OBSTACLES ? SIDESTEP_TOO_MANY : SIDESTEP_OK;
    if (!result && !take_obstacles(c, obstacles, count)) result = SIDESTEP_INPUT;
    c->state = *state;
    if (result) {
        fall_back(c);
    } else {
        c->before = c->memory;
        if (!run(c, count)) {
            c->memory = c->before;
            fall_back(c);
            result = SIDESTEP_ARENA;
        } else if (c->memory.heard == c->before.heard) {
            result = SIDESTEP_INPUT;
        }
    }
    *command = c->memory.command;
    return result;
}

const sidestep_plan *sidestep_last_plan(const sidestep *c) {
    return c->memory.last < 0 ? NULL : &c->memory.plans[c->memory.last];
}

double sidestep_clearance(sidestep *c, const sidestep_state *state, const sidestep_obstacle obstacles[], size_t count) {
    if (count > SIDESTEP_MOST_OBSTACLES || !take_obstacles(c, obstacles, count)) return NAN;
    c->state = *state;
    arena_enter(&c->arena);
    double distance = sidestep_kernel_clearance(&c->setup, c->table, c->setup.rows, &c->boxes[0][0], (int64_t)count,
                                                &c->state);
    arena_enter(NULL);
    return distance;
}

void sidestep_get_parameters(const sidestep *c, sidestep_parameters *parameters) { *parameters = c->parameters; }

int sidestep_set_parameters(sidestep *c, const sidestep_parameters *parameters) {
    double values[sizeof *parameters / sizeof(double)];
    memcpy(values, parameters, sizeof values);
    for (size_t i = 0; i < sizeof values / sizeof *values; i++)
        if (!(values[i] >= PARAMETER_BOUNDS[i][0] && values[i] <= PARAMETER_BOUNDS[i][1]) &&
            !(i == CRUISE_SPEED && isnan(values[i])))
            return SIDESTEP_RANGE;
    c->parameters = *parameters;
    tune(c);
    return SIDESTEP_OK;
}

size_t sidestep_memory_size(void) { return sizeof(MemoryHeader) + sizeof(sidestep_memory); }

int sidestep_save(const sidestep *c, void *bytes, size_t size) {
    MemoryHeader head = {"", MEMORY_VERSION, checksum(&c->memory, sizeof c->memory), sizeof c->memory};
    if (size < sidestep_memory_size()) return SIDESTEP_FOREIGN;
    memcpy(head.name, NAME, sizeof NAME);
    memcpy(bytes, &head, sizeof head);
    memcpy((char *)bytes + sizeof head, &c->memory, sizeof c->memory);
    return SIDESTEP_OK;
}

int sidestep_restore(sidestep *c, const void *bytes, size_t size) {
    MemoryHeader head;
    const char *body = (const char *)bytes + sizeof head;
    if (size != sidestep_memory_size()) return SIDESTEP_FOREIGN;
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.name, NAME, sizeof NAME) || head.version != MEMORY_VERSION || head.size != sizeof c->memory ||
        head.checksum != checksum(body, sizeof c->memory))
        return SIDESTEP_FOREIGN;
    memcpy(&c->memory, body, sizeof c->memory);
    tune(c);
    return SIDESTEP_OK;
}

size_t sidestep_instance_size(const sidestep *c) { return c->size; }
size_t sidestep_arena_peak(const sidestep *c) { return c->arena.peak; }
