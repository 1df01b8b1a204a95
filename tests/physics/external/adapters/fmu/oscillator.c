/* x' = v, v' = -k x - c v + f + n t, as an FMU of FMI 2 or 3 (macro FMI).
   With the macro EVENTS it bounces where x = -0.5: v becomes -0.7 v.
   With the macro BENT the damping is c (x² - 1) v: van der Pol's oscillator.
   The macro DERIVATIVES is the factor of its directional derivatives; without it there are none. */
#include <stdbool.h>
#include <stdlib.h>

enum { TIME, X, DX, V, DV, K, C, F, N, COUNT };

typedef struct {
    double value[COUNT];
    void (*logger)();
    void *environment;
} Model;

static void reset(Model *m) {
    double start[COUNT] = {[X] = 1, [K] = 4, [C] = 0.1};
    for (int i = 0; i < COUNT; i++) m->value[i] = start[i];
}

static void tendency(Model *m) {
    double *u = m->value;
    u[DX] = u[V];
    u[DV] = -u[K] * u[X] - u[C] * (BENT ? u[X] * u[X] - 1 : 1) * u[V] + u[F] + u[N] * u[TIME];
}

#ifdef DERIVATIVES
static double partial(Model *m, unsigned unknown, unsigned known) {
    double *u = m->value;
    if (unknown == DX) return known == V;
    if (known == X) return -u[K] - (BENT ? 2 * u[C] * u[X] * u[V] : 0);
    return known == V ? -u[C] * (BENT ? u[X] * u[X] - 1 : 1) : 0;
}

static int get_along(Model *m, const unsigned *unknowns, size_t rows, const unsigned *knowns,
                     size_t columns, const double *seed, double *result) {
    for (size_t i = 0; i < rows; i++) {
        result[i] = 0;
        for (size_t j = 0; j < columns; j++)
            result[i] += DERIVATIVES * partial(m, unknowns[i], knowns[j]) * seed[j];
    }
    return 0;
}
#endif

static int failed(Model *m, const char *message) {
#if FMI == 2
    m->logger(m->environment, "oscillator", 3, "error", message);
#else
    m->logger(m->environment, 3, "error", message);
#endif
    return 3;
}

static int set(Model *m, const unsigned *vr, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == K && values[i] < 0) return failed(m, "k must not be negative");
        m->value[vr[i]] = values[i];
    }
    return 0;
}

static int get(Model *m, const unsigned *vr, size_t n, double *values) {
    tendency(m);
    for (size_t i = 0; i < n; i++) values[i] = m->value[vr[i]];
    return 0;
}

static int set_integers(Model *m, const unsigned *vr, size_t n, const int *values) {
    for (size_t i = 0; i < n; i++) m->value[vr[i]] = values[i];
    return 0;
}

static int get_integers(Model *m, const unsigned *vr, size_t n, int *x) {
    for (size_t i = 0; i < n; i++) x[i] = (int)m->value[vr[i]];
    return 0;
}

static int set_time(Model *m, double t) { m->value[TIME] = t; return 0; }

static int set_states(Model *m, const double *x, size_t n) {
    m->value[X] = x[0], m->value[V] = x[1];
    return 0;
}

static int get_states(Model *m, double *x, size_t n) {
    x[0] = m->value[X], x[1] = m->value[V];
    return 0;
}

static int get_slopes(Model *m, double *x, size_t n) {
    tendency(m);
    x[0] = m->value[DX], x[1] = m->value[DV];
    return 0;
}

static int get_nominals(Model *m, double *x, size_t n) { x[0] = x[1] = 1; return 0; }

static int get_indicators(Model *m, double *z, size_t n) {
    if (n) z[0] = m->value[X] + 0.5;
    return 0;
}

static void bounce(Model *m) {
#if EVENTS
    if (m->value[X] <= -0.5 && m->value[V] < 0) m->value[V] *= -0.7;
#endif
}

static int do_step(Model *m, double t, double dt) {
    double *u = m->value;
    if (dt > 1) return failed(m, "the step is longer than 1");
    for (int i = 0; i < 1000; i++) { /* the method of Heun */
        double h = dt / 1000, x = u[X], v = u[V];
        u[TIME] = t + i * h;
        tendency(m);
        double dx = u[DX], dv = u[DV];
        u[X] = x + h * dx, u[V] = v + h * dv, u[TIME] += h;
        tendency(m);
        u[X] = x + h / 2 * (dx + u[DX]), u[V] = v + h / 2 * (dv + u[DV]);
    }
    return 0;
}

static Model *instantiate(void (*logger)(), void *environment) {
    Model *m = calloc(1, sizeof(Model));
    m->logger = logger, m->environment = environment;
    reset(m);
    return m;
}

#if FMI == 2
typedef struct { void (*logger)(); void *allocate, *release, *finished, *environment; } Callbacks;
typedef struct { int again, ends, nominals, states, has_next; double next; } EventInfo;

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *path,
                      const Callbacks *callbacks, int visible, int logging) {
    return instantiate(callbacks->logger, callbacks->environment);
}
void fmi2FreeInstance(Model *m) { free(m); }
int fmi2Reset(Model *m) { reset(m); return 0; }
int fmi2SetupExperiment(Model *m, int has_tolerance, double tolerance, double start, int has_stop,
                        double stop) { return set_time(m, start); }
int fmi2EnterInitializationMode(Model *m) { return 0; }
int fmi2ExitInitializationMode(Model *m) { return 0; }
int fmi2SetReal(Model *m, const unsigned *vr, size_t n, const double *x) { return set(m, vr, n, x); }
int fmi2GetReal(Model *m, const unsigned *vr, size_t n, double *x) { return get(m, vr, n, x); }
int fmi2SetInteger(Model *m, const unsigned *vr, size_t n, const int *x) {
    return set_integers(m, vr, n, x);
}
int fmi2GetInteger(Model *m, const unsigned *vr, size_t n, int *x) {
    return get_integers(m, vr, n, x);
}
int fmi2SetTime(Model *m, double t) { return set_time(m, t); }
int fmi2SetContinuousStates(Model *m, const double *x, size_t n) { return set_states(m, x, n); }
int fmi2GetContinuousStates(Model *m, double *x, size_t n) { return get_states(m, x, n); }
int fmi2GetNominalsOfContinuousStates(Model *m, double *x, size_t n) { return get_nominals(m, x, n); }
int fmi2GetDerivatives(Model *m, double *x, size_t n) { return get_slopes(m, x, n); }
int fmi2GetEventIndicators(Model *m, double *z, size_t n) { return get_indicators(m, z, n); }
int fmi2EnterEventMode(Model *m) { bounce(m); return 0; }
int fmi2EnterContinuousTimeMode(Model *m) { return 0; }
int fmi2NewDiscreteStates(Model *m, EventInfo *info) { *info = (EventInfo){0}; return 0; }
int fmi2CompletedIntegratorStep(Model *m, int keeps, int *event, int *ends) {
    *event = *ends = 0;
    return 0;
}
int fmi2Terminate(Model *m) { return 0; }
#ifdef DERIVATIVES
int fmi2GetDirectionalDerivative(Model *m, const unsigned *unknowns, size_t rows,
                                 const unsigned *knowns, size_t columns, const double *seed,
                                 double *result) {
    return get_along(m, unknowns, rows, knowns, columns, seed, result);
}
#endif
int fmi2DoStep(Model *m, double t, double dt, int keeps) { return do_step(m, t, dt); }
#else
void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *path,
                                   bool visible, bool logging, void *environment,
                                   void (*logger)()) {
    return instantiate(logger, environment);
}
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *path,
                                  bool visible, bool logging, bool events, bool early,
                                  const unsigned *vr, size_t n, void *environment,
                                  void (*logger)(), void *update) {
    return instantiate(logger, environment);
}
void fmi3FreeInstance(Model *m) { free(m); }
int fmi3Reset(Model *m) { reset(m); return 0; }
int fmi3EnterInitializationMode(Model *m, bool has_tolerance, double tolerance, double start,
                                bool has_stop, double stop) { return set_time(m, start); }
int fmi3ExitInitializationMode(Model *m) { return 0; }
int fmi3SetFloat64(Model *m, const unsigned *vr, size_t n, const double *x, size_t size) {
    return set(m, vr, n, x);
}
int fmi3GetFloat64(Model *m, const unsigned *vr, size_t n, double *x, size_t size) {
    return get(m, vr, n, x);
}
int fmi3SetInt32(Model *m, const unsigned *vr, size_t n, const int *x, size_t size) {
    return set_integers(m, vr, n, x);
}
int fmi3GetInt32(Model *m, const unsigned *vr, size_t n, int *x, size_t size) {
    return get_integers(m, vr, n, x);
}
int fmi3SetTime(Model *m, double t) { return set_time(m, t); }
int fmi3SetContinuousStates(Model *m, const double *x, size_t n) { return set_states(m, x, n); }
int fmi3GetContinuousStates(Model *m, double *x, size_t n) { return get_states(m, x, n); }
int fmi3GetNominalsOfContinuousStates(Model *m, double *x, size_t n) { return get_nominals(m, x, n); }
int fmi3GetContinuousStateDerivatives(Model *m, double *x, size_t n) { return get_slopes(m, x, n); }
int fmi3GetNumberOfEventIndicators(Model *m, size_t *n) { *n = EVENTS; return 0; }
int fmi3GetEventIndicators(Model *m, double *z, size_t n) { return get_indicators(m, z, n); }
int fmi3EnterEventMode(Model *m) { bounce(m); return 0; }
int fmi3EnterContinuousTimeMode(Model *m) { return 0; }
int fmi3UpdateDiscreteStates(Model *m, bool *again, bool *ends, bool *nominals, bool *states,
                             bool *has_next, double *next) {
    *again = *ends = *nominals = *states = *has_next = false, *next = 0;
    return 0;
}
int fmi3CompletedIntegratorStep(Model *m, bool keeps, bool *event, bool *ends) {
    *event = *ends = false;
    return 0;
}
int fmi3Terminate(Model *m) { return 0; }
#ifdef DERIVATIVES
int fmi3GetDirectionalDerivative(Model *m, const unsigned *unknowns, size_t rows,
                                 const unsigned *knowns, size_t columns, const double *seed,
                                 size_t n, double *result, size_t size) {
    return get_along(m, unknowns, rows, knowns, columns, seed, result);
}
#endif
int fmi3DoStep(Model *m, double t, double dt, bool keeps, bool *event, bool *ends, bool *early,
               double *last) {
    *event = *ends = *early = false, *last = t + dt;
    return do_step(m, t, dt);
}
#endif
