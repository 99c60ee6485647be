/* FMI 3.0 for co-simulation, of one machine. Types and functions are those of the standard, sections 2.2, 2.3 and 4
 * (https://fmi-standard.org), written here from its text: no header of it is needed. */
#include "machine.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*Logger)(void *environment, fmi3Status status, const char *category, const char *message);
typedef const char *Text;
typedef const uint8_t *Binary;

typedef struct {
    Machine machine;
    Logger logger;
    void *environment;
} Instance;

static fmi3Status told(const Instance *of, const char *wrong) {
    if (!wrong) return fmi3OK;
    if (of && of->logger) of->logger(of->environment, fmi3Error, "logStatusError", wrong);
    return fmi3Error;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(void *c, bool on, size_t n, const Text categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

EXPORT void *fmi3InstantiateCoSimulation(Text name, Text token, Text resources, bool visible, bool logging,
                                         bool events, bool early_return, const uint32_t intermediate[], size_t n,
                                         void *environment, Logger logger, void *update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early_return;
    (void)intermediate, (void)n, (void)update;
    Instance *of = calloc(1, sizeof *of);
    if (!of) return NULL;
    of->logger = logger;
    of->environment = environment;
    machine_reset(&of->machine);
    const bool ours = token && strcmp(token, TOKEN) == 0;
    if (told(of, ours ? NULL : "the token is not this FMU's: binary and description differ") == fmi3OK) return of;
    free(of);
    return NULL;
}

EXPORT void *fmi3InstantiateModelExchange(Text name, Text token, Text resources, bool visible, bool logging,
                                          void *environment, Logger logger) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    return NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(Text name, Text token, Text resources, bool visible, bool logging,
                                               void *environment, Logger logger, void *update, void *lock,
                                               void *unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    (void)update, (void)lock, (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(void *c) { free(c); }

EXPORT fmi3Status fmi3EnterInitializationMode(void *c, bool tolerance_defined, double tolerance, double start,
                                              bool stop_defined, double stop) {
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    return told(c, machine_rest(&((Instance *)c)->machine, start));
}

EXPORT fmi3Status fmi3ExitInitializationMode(void *c) {
    return told(c, machine_rest(&((Instance *)c)->machine, ((Instance *)c)->machine.time));
}

EXPORT fmi3Status fmi3Terminate(void *c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3Reset(void *c) { machine_reset(&((Instance *)c)->machine); return fmi3OK; }

EXPORT fmi3Status fmi3GetFloat64(void *c, const uint32_t vr[], size_t n, double value[], size_t values) {
    Machine *machine = &((Instance *)c)->machine;
    machine_outputs(machine);
    if (values < n) return told(c, "there is less room than values");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= N_VARIABLES) return told(c, "there is no variable of that value reference");
        value[i] = machine->value[vr[i]];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(void *c, const uint32_t vr[], size_t n, const double value[], size_t values) {
    if (values < n) return told(c, "there are fewer values than variables");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= N_VARIABLES || vr[i] == TIME || (vr[i] >= FIRST_OUTPUT && vr[i] <= LAST_OUTPUT))
            return told(c, "that variable cannot be set");
        ((Instance *)c)->machine.value[vr[i]] = value[i];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(void *c, double time, double duration, bool no_earlier_state, bool *event,
                             bool *terminate, bool *early, double *last) {
    (void)time, (void)no_earlier_state;
    *event = *terminate = *early = false;
    const fmi3Status status = told(c, machine_step(&((Instance *)c)->machine, duration));
    *last = ((Instance *)c)->machine.time;
    return status;
}

EXPORT fmi3Status fmi3GetFMUState(void *c, void **state) {
    if (!*state) *state = malloc(sizeof(Machine));
    if (!*state) return told(c, "out of memory");
    memcpy(*state, &((Instance *)c)->machine, sizeof(Machine));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(void *c, void *state) {
    memcpy(&((Instance *)c)->machine, state, sizeof(Machine));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(void *c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(void *c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Machine);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(void *c, void *state, uint8_t bytes[], size_t size) {
    if (size < sizeof(Machine)) return told(c, "a serialised state needs more room");
    memcpy(bytes, state, sizeof(Machine));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(void *c, const uint8_t bytes[], size_t size, void **state) {
    if (size != sizeof(Machine)) return told(c, "that is no state of this FMU");
    if (!*state) *state = malloc(sizeof(Machine));
    if (!*state) return told(c, "out of memory");
    memcpy(*state, bytes, sizeof(Machine));
    return fmi3OK;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(void *c, bool *more, bool *terminate, bool *nominals, bool *values,
                                           bool *defined, double *next) {
    (void)c, (void)next;
    *more = *terminate = *nominals = *values = *defined = false;
    return fmi3OK;
}

/* What the standard wants to be there, and this FMU has nothing of. */
#define NOTHING_OF(name, type)                                                                            \
    EXPORT fmi3Status fmi3Get##name(void *c, const uint32_t vr[], size_t n, type value[], size_t values) {  \
        (void)vr, (void)value, (void)values;                                                              \
        return n == 0 ? fmi3OK : told(c, "all variables are of type Float64");                            \
    }                                                                                                     \
    EXPORT fmi3Status fmi3Set##name(void *c, const uint32_t vr[], size_t n, const type value[], size_t values) { \
        (void)vr, (void)value, (void)values;                                                              \
        return n == 0 ? fmi3OK : told(c, "all variables are of type Float64");                            \
    }
NOTHING_OF(Float32, float)
NOTHING_OF(Int8, int8_t)
NOTHING_OF(UInt8, uint8_t)
NOTHING_OF(Int16, int16_t)
NOTHING_OF(UInt16, uint16_t)
NOTHING_OF(Int32, int32_t)
NOTHING_OF(UInt32, uint32_t)
NOTHING_OF(Int64, int64_t)
NOTHING_OF(UInt64, uint64_t)
NOTHING_OF(Boolean, bool)
NOTHING_OF(String, Text)

/* With any arguments: a caller's are its own to clear away. */
#define NOT_PROVIDED(name, ...)                                           \
    EXPORT fmi3Status fmi3##name(void *c, __VA_ARGS__) {                  \
        return told(c, "fmi3" #name " is not provided by this FMU");      \
    }
#define NOT_PROVIDED_ALONE(name)                                          \
    EXPORT fmi3Status fmi3##name(void *c) { return told(c, "fmi3" #name " is not provided by this FMU"); }
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOT_PROVIDED(GetBinary, const uint32_t vr[], size_t n, size_t sizes[], Binary value[], size_t values)
NOT_PROVIDED(SetBinary, const uint32_t vr[], size_t n, const size_t sizes[], const Binary value[], size_t values)
NOT_PROVIDED(GetClock, const uint32_t vr[], size_t n, bool value[])
NOT_PROVIDED(SetClock, const uint32_t vr[], size_t n, const bool value[])
NOT_PROVIDED(GetNumberOfVariableDependencies, uint32_t vr, size_t *n)
NOT_PROVIDED(GetVariableDependencies, uint32_t vr, size_t at[], uint32_t on[], size_t elements[], int kinds[], size_t n)
NOT_PROVIDED(GetDirectionalDerivative, const uint32_t unknown[], size_t n, const uint32_t known[], size_t m,
             const double seed[], size_t seeds, double sensitivity[], size_t sensitivities)
NOT_PROVIDED(GetAdjointDerivative, const uint32_t unknown[], size_t n, const uint32_t known[], size_t m,
             const double seed[], size_t seeds, double sensitivity[], size_t sensitivities)
NOT_PROVIDED_ALONE(EnterConfigurationMode)
NOT_PROVIDED_ALONE(ExitConfigurationMode)
NOT_PROVIDED_ALONE(EnterEventMode)
NOT_PROVIDED_ALONE(EnterStepMode)
NOT_PROVIDED_ALONE(EnterContinuousTimeMode)
NOT_PROVIDED_ALONE(EvaluateDiscreteStates)
NOT_PROVIDED(GetIntervalDecimal, const uint32_t vr[], size_t n, double interval[], int qualifiers[])
NOT_PROVIDED(GetIntervalFraction, const uint32_t vr[], size_t n, uint64_t counter[], uint64_t resolution[], int q[])
NOT_PROVIDED(GetShiftDecimal, const uint32_t vr[], size_t n, double shift[])
NOT_PROVIDED(GetShiftFraction, const uint32_t vr[], size_t n, uint64_t counter[], uint64_t resolution[])
NOT_PROVIDED(SetIntervalDecimal, const uint32_t vr[], size_t n, const double interval[])
NOT_PROVIDED(SetIntervalFraction, const uint32_t vr[], size_t n, const uint64_t counter[], const uint64_t resolution[])
NOT_PROVIDED(SetShiftDecimal, const uint32_t vr[], size_t n, const double shift[])
NOT_PROVIDED(SetShiftFraction, const uint32_t vr[], size_t n, const uint64_t counter[], const uint64_t resolution[])
NOT_PROVIDED(CompletedIntegratorStep, bool no_earlier_state, bool *event, bool *terminate)
NOT_PROVIDED(SetTime, double time)
NOT_PROVIDED(SetContinuousStates, const double states[], size_t n)
NOT_PROVIDED(GetContinuousStateDerivatives, double derivatives[], size_t n)
NOT_PROVIDED(GetEventIndicators, double indicators[], size_t n)
NOT_PROVIDED(GetContinuousStates, double states[], size_t n)
NOT_PROVIDED(GetNominalsOfContinuousStates, double nominals[], size_t n)
NOT_PROVIDED(GetNumberOfEventIndicators, size_t *n)
NOT_PROVIDED(GetNumberOfContinuousStates, size_t *n)
NOT_PROVIDED(GetOutputDerivatives, const uint32_t vr[], size_t n, const int32_t orders[], double value[], size_t values)
NOT_PROVIDED(ActivateModelPartition, uint32_t clock, double time)
