/* FMI 2.0 for co-simulation, of one machine. Types and functions are those of the standard, section 2.1 and 4.2
 * (https://fmi-standard.org), written here from its text: no header of it is needed. */
#include "machine.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef void (*Logger)(void *environment, const char *name, fmi2Status status, const char *category,
                       const char *message, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, fmi2Status status);
    void *environment;
} Callbacks;

typedef struct {
    Machine machine;
    const Callbacks *callbacks;
    char *name;
} Instance;

static char *copied(const char *text) {
    char *copy = malloc(strlen(text) + 1);
    return copy ? strcpy(copy, text) : NULL;
}

static fmi2Status told(const Instance *of, const char *wrong) {
    if (!wrong) return fmi2OK;
    if (of->callbacks && of->callbacks->logger)
        of->callbacks->logger(of->callbacks->environment, of->name, fmi2Error, "logStatusError", "%s", wrong);
    return fmi2Error;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logging) {
    (void)resources, (void)visible, (void)logging;
    Instance *of = calloc(1, sizeof *of);
    if (!of) return NULL;
    of->callbacks = callbacks;
    of->name = copied(name ? name : "");
    machine_reset(&of->machine);
    const char *wrong = type != 1 ? "this FMU is for co-simulation only" : NULL;
    if (!wrong && (!guid || strcmp(guid, TOKEN) != 0)) wrong = "the GUID is not this FMU's: binary and description differ";
    if (told(of, wrong) == fmi2OK && of->name) return of;
    free(of->name);
    free(of);
    return NULL;
}

EXPORT void fmi2FreeInstance(void *c) {
    if (!c) return;
    free(((Instance *)c)->name);
    free(c);
}

EXPORT fmi2Status fmi2SetupExperiment(void *c, int tolerance_defined, double tolerance, double start, int stop_defined,
                                      double stop) {
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((Instance *)c)->machine.time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(void *c) { return told(c, machine_rest(&((Instance *)c)->machine, ((Instance *)c)->machine.time)); }
EXPORT fmi2Status fmi2ExitInitializationMode(void *c) { return fmi2EnterInitializationMode(c); }
EXPORT fmi2Status fmi2Terminate(void *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(void *c) { machine_reset(&((Instance *)c)->machine); return fmi2OK; }

EXPORT fmi2Status fmi2GetReal(void *c, const unsigned vr[], size_t n, double value[]) {
    Machine *machine = &((Instance *)c)->machine;
    machine_outputs(machine);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= N_VARIABLES) return told(c, "there is no variable of that value reference");
        value[i] = machine->value[vr[i]];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(void *c, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= N_VARIABLES || vr[i] == TIME || (vr[i] >= FIRST_OUTPUT && vr[i] <= LAST_OUTPUT))
            return told(c, "that variable cannot be set");
        ((Instance *)c)->machine.value[vr[i]] = value[i];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(void *c, double time, double duration, int no_earlier_state) {
    (void)time, (void)no_earlier_state;
    return told(c, machine_step(&((Instance *)c)->machine, duration));
}

EXPORT fmi2Status fmi2GetFMUstate(void *c, void **state) {
    if (!*state) *state = malloc(sizeof(Machine));
    if (!*state) return told(c, "out of memory");
    memcpy(*state, &((Instance *)c)->machine, sizeof(Machine));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(void *c, void *state) {
    memcpy(&((Instance *)c)->machine, state, sizeof(Machine));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(void *c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Machine);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size) {
    if (size < sizeof(Machine)) return told(c, "a serialised state needs more room");
    memcpy(bytes, state, sizeof(Machine));
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state) {
    if (size != sizeof(Machine)) return told(c, "that is no state of this FMU");
    if (!*state) *state = malloc(sizeof(Machine));
    if (!*state) return told(c, "out of memory");
    memcpy(*state, bytes, sizeof(Machine));
    return fmi2OK;
}

/* What the standard wants to be there, and this FMU has nothing of. */
#define NOTHING_OF(name, type)                                                             \
    EXPORT fmi2Status fmi2Get##name(void *c, const unsigned vr[], size_t n, type value[]) {  \
        (void)vr, (void)value;                                                             \
        return n == 0 ? fmi2OK : told(c, "all variables are real");                        \
    }                                                                                      \
    EXPORT fmi2Status fmi2Set##name(void *c, const unsigned vr[], size_t n, const type value[]) { \
        (void)vr, (void)value;                                                             \
        return n == 0 ? fmi2OK : told(c, "all variables are real");                        \
    }
typedef const char *Text;
NOTHING_OF(Integer, int)
NOTHING_OF(Boolean, int)
NOTHING_OF(String, Text)

EXPORT fmi2Status fmi2GetDirectionalDerivative(void *c, const unsigned unknown[], size_t n, const unsigned known[],
                                               size_t m, const double seed[], double sensitivity[]) {
    (void)unknown, (void)n, (void)known, (void)m, (void)seed, (void)sensitivity;
    return told(c, "directional derivatives are not provided");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(void *c, const unsigned vr[], size_t n, const int order[],
                                              const double value[]) {
    (void)vr, (void)n, (void)order, (void)value;
    return told(c, "input derivatives are not used: the torque is held over a step");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(void *c, const unsigned vr[], size_t n, const int order[],
                                               double value[]) {
    (void)vr, (void)n, (void)order, (void)value;
    return told(c, "output derivatives are not provided");
}

#define NO_STATUS(name, type)                                     \
    EXPORT fmi2Status fmi2Get##name(void *c, int kind, type *value) { \
        (void)c, (void)kind, (void)value;                         \
        return fmi2Discard;                                       \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, double)
NO_STATUS(IntegerStatus, int)
NO_STATUS(BooleanStatus, int)
NO_STATUS(StringStatus, Text)

EXPORT fmi2Status fmi2CancelStep(void *c) { return told(c, "steps do not run beside their caller"); }
