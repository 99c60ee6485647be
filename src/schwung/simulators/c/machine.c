/* Equations of the machine, and their solution: classical Runge-Kutta, in as many steps as what is fastest needs. */
#include "machine.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define TWO_PI 6.283185307179586476925287
#define LONGEST_STEP 2.5e-4   /* s */
#define COUPLING_STEP 0.1     /* highest |eigenvalue| x step ... */
#define CONTACT_STEP 0.02     /* ... where the coupling has play ... */
#define FRICTION_STEP 1.0     /* ... and of smoothed dry friction, which has to be stable only */
#define MOST_STEPS 100000000.0
#define REPORTED_STEPS 50     /* of Newton's, which ends sooner */

typedef struct {
    double value, slope;
} Point;

static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

/* A curve through rows of angle, value and slope: cubic between them, constant beyond. */
static Point curve(const double (*rows)[3], int count, double angle) {
    int low = 0, high = count - 1;
    const double inside = smaller(larger(angle, rows[0][0]), rows[high][0]);
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (inside < rows[middle][0]) high = middle; else low = middle;
    }
    const double *a = rows[low], *b = rows[high];
    const double width = b[0] - a[0], u = inside - a[0], secant = (b[1] - a[1]) / width;
    const double square = (3.0 * secant - 2.0 * a[2] - b[2]) / width;
    const double cube = (a[2] + b[2] - 2.0 * secant) / (width * width);
    Point result;
    result.value = ((cube * u + square) * u + a[2]) * u + a[1];
    result.slope = inside == angle ? (3.0 * cube * u + 2.0 * square) * u + a[2] : 0.0;
    return result;
}

#define CURVE(rows, angle) curve(rows, (int)(sizeof(rows) / sizeof((rows)[0])), angle)

/* A table over two coordinates: bilinear, constant beyond; its first row and column are the points. */
static double plane(const double *rows, int high, int wide, double x, double y) {
    int i = 1, j = 1;
    x = smaller(larger(x, rows[wide]), rows[(high - 1) * wide]);
    y = smaller(larger(y, rows[1]), rows[wide - 1]);
    while (i < high - 2 && rows[(i + 1) * wide] <= x) i++;
    while (j < wide - 2 && rows[j + 1] <= y) j++;
    const double *a = rows + i * wide, *b = a + wide;
    const double u = (x - a[0]) / (b[0] - a[0]), v = (y - rows[j]) / (rows[j + 1] - rows[j]);
    return (1.0 - v) * ((1.0 - u) * a[j] + u * b[j]) + v * ((1.0 - u) * a[j + 1] + u * b[j + 1]);
}

#define WIDE(rows) ((int)(sizeof((rows)[0]) / sizeof(double)))
#define HIGH(rows) ((int)(sizeof(rows) / sizeof((rows)[0])))
#define PLANE(rows, x, y) plane(&(rows)[0][0], HIGH(rows), WIDE(rows), x, y)

/* The largest slope over the second coordinate, unsigned. */
static double steepest(const double *rows, int high, int wide) {
    double most = 0.0;
    for (int i = 1; i < high; i++)
        for (int j = 1; j < wide - 1; j++)
            most = larger(most, fabs((rows[i * wide + j + 1] - rows[i * wide + j]) / (rows[j + 1] - rows[j])));
    return most;
}

static Point load_inertia(const double *p, double angle) {
    Point point = CURVE(INERTIA, angle + p[INERTIA_SHIFT_RAD]);
    point.value = p[INERTIA_SCALE] * point.value + p[INERTIA_DELTA_KGM2];
    point.slope *= p[INERTIA_SCALE];
    const Point added = CURVE(INERTIA_ADDED, angle);
    point.value += added.value;
    point.slope += added.slope;
    return point;
}

static double lightest_load(const double *p) {
    double lightest = INERTIA[0][1];
    for (size_t i = 1; i < sizeof INERTIA / sizeof INERTIA[0]; i++) lightest = smaller(lightest, INERTIA[i][1]);
    double added = INERTIA_ADDED[0][1];
    for (size_t i = 1; i < sizeof INERTIA_ADDED / sizeof INERTIA_ADDED[0]; i++)
        added = smaller(added, INERTIA_ADDED[i][1]);
    return p[INERTIA_SCALE] * lightest + p[INERTIA_DELTA_KGM2] + added;
}

static double rotor_inertia(const double *p) {
    return p[ROTOR_INERTIA_KGM2] > 0.0 ? p[ROTOR_INERTIA_KGM2] : p[MOTOR_INERTIA_KGM2];
}

static double stiffness(const double *p) {
    return p[STIFFNESS_NM_RAD] > 0.0 ? p[STIFFNESS_NM_RAD] : p[COUPLING_STIFFNESS_NM_RAD];
}

static double damping(const double *p) {
    return p[DAMPING_NMS] >= 0.0 ? p[DAMPING_NMS] : p[COUPLING_DAMPING_NMS];
}

/* Of the third mass, which the load's speed may stiffen. */
static double third_stiffness(const double *p, double speed) {
    return p[THIRD_STIFFNESS_NM_RAD] + p[THIRD_INERTIA_KGM2] * p[THIRD_SPEED_SHARE] * speed * speed;
}

/* 1 in the middle of 0..1, 0 at the ends and beyond: a raised cosine to a power. */
static double bump(double share, double sharpness) {
    if (!(share > 0.0 && share < 1.0)) return 0.0;
    return pow(0.5 * (1.0 - cos(TWO_PI * share)), sharpness);
}

/* What dry friction has gained after a share of the session. */
static double drift(const double *p) {
    const double settling = p[DRIFT_SETTLING], share = p[SESSION_SHARE];
    if (fabs(settling) < 1e-3) return p[DRIFT_NM] * share;
    return p[DRIFT_NM] * expm1(-settling * share) / expm1(-settling);
}

/* Learned torques that are tables, one for each direction of motion (-1..1). */
#define SIDED(rows, x, way)                                                                                           \
    ((way) >= 0.0 ? CURVE(rows##_FORWARD, x).value * (way) : -CURVE(rows##_BACKWARD, x).value * (way))

#define HIGHEST(rows) larger(highest(rows##_FORWARD, (int)(sizeof rows##_FORWARD / sizeof rows##_FORWARD[0])),       \
                             highest(rows##_BACKWARD, (int)(sizeof rows##_BACKWARD / sizeof rows##_BACKWARD[0])))

static double highest(const double (*rows)[3], int count) {
    double most = 0.0;
    for (int i = 0; i < count; i++) most = larger(most, fabs(rows[i][1]));
    return most;
}

/* Acceleration a with inertia a = torque + curve(a): Newton. */
static double accelerated(double torque, double inertia) {
    double a = torque / inertia;
    for (int i = 0; i < 8; i++) {
        const Point point = CURVE(RESIDUAL_ACCELERATION, a);
        a += (torque + point.value - inertia * a) / larger(inertia - point.slope, 0.1 * inertia);
    }
    return a;
}

/* Level of dry friction on the motor: direction, drift, Stribeck, a tight spot that comes back every turn. */
static double dry_friction(const double *p, double angle, double speed) {
    double level = speed > 0.0 ? p[COULOMB_POSITIVE_NM] : p[COULOMB_NEGATIVE_NM];
    level += drift(p);
    if (p[STRIBECK_RISE_NM] != 0.0)
        level += p[STRIBECK_RISE_NM]
                 * exp(-pow(fabs(speed) / p[STRIBECK_SPEED_RAD_S], p[STRIBECK_EXPONENT]));
    if (p[LOCAL_FRICTION_NM] != 0.0) {
        double away = angle - p[LOCAL_CENTRE_RAD];
        away -= TWO_PI * nearbyint(away / TWO_PI);
        level += p[LOCAL_FRICTION_NM] * bump(0.5 + away / p[LOCAL_WIDTH_RAD], p[LOCAL_SHARPNESS]);
    }
    return larger(level, 0.0);
}

/* What teeth and magnets do to the motor (N.m): a wave, and one of twice the order. */
static double cogging(const double *p, double angle) {
    double torque = 0.0;
    if (p[COGGING_AMPLITUDE_NM] != 0.0)
        torque += p[COGGING_AMPLITUDE_NM] * sin(p[COGGING_ORDER] * angle + p[COGGING_PHASE_RAD]);
    if (p[COGGING_SECOND_NM] != 0.0)
        torque += p[COGGING_SECOND_NM] * sin(2.0 * p[COGGING_ORDER] * angle + p[COGGING_SECOND_PHASE_RAD]);
    return torque;
}

/* What friction and disturbances add to the motor's torque. */
static double motor_torque(const double *p, double angle, double speed, double time) {
    double torque = p[OFFSET_NM] - (p[VISCOUS_NMS] + p[DRAG_NMS2] * fabs(speed)) * speed;
    torque += p[SESSION_SHARE] * (p[OFFSET_DRIFT_NM] - p[VISCOUS_DRIFT_NMS] * speed);
    torque -= 0.5 * p[VISCOUS_DIFFERENCE_NMS] * fabs(speed);
    torque -= dry_friction(p, angle, speed) * tanh(speed / p[SMOOTHING_RAD_S]);
    torque += cogging(p, angle);
    if (p[PERIODIC_AMPLITUDE_NM] != 0.0)
        torque += p[PERIODIC_AMPLITUDE_NM]
                  * sin(TWO_PI * p[PERIODIC_FREQUENCY_HZ] * time + p[PERIODIC_PHASE_RAD]);
    return torque;
}

/* What acts on the load from outside: tables, a sine and springs over its angle, one event (motion_time: since the start). */
static double load_torque(const double *p, double angle, double motion_time) {
    double torque = p[LOAD_TORQUE_NM] + CURVE(LOAD_TORQUE, angle).value + CURVE(LEARNED_LOAD_TORQUE, angle).value;
    torque += CURVE(RESIDUAL_TIME_IN_MOTION, motion_time).value;
    if (p[LOAD_AMPLITUDE_NM] != 0.0) torque += p[LOAD_AMPLITUDE_NM] * sin(angle + p[LOAD_PHASE_RAD]);
    if (p[END_HIGH_NM_RAD] != 0.0) torque -= p[END_HIGH_NM_RAD] * larger(angle - p[END_HIGH_RAD], 0.0);
    if (p[END_LOW_NM_RAD] != 0.0) torque += p[END_LOW_NM_RAD] * larger(p[END_LOW_RAD] - angle, 0.0);
    if (p[EVENT_PEAK_NM] != 0.0)
        torque += p[EVENT_PEAK_NM]
                  * bump((motion_time - p[EVENT_TIME_S]) / p[EVENT_DURATION_S], p[EVENT_SHARPNESS]);
    return torque;
}

/* What the coupling takes from the motor and gives to the load. With play it can only push. */
static double coupling_torque(const double *p, double motor_angle, double twist, double twist_speed) {
    const double along = p[STIFFNESS_SHARE] * sin(p[STIFFNESS_ORDER] * motor_angle + p[STIFFNESS_PHASE_RAD]);
    const double k = stiffness(p) * (1.0 + along), d = damping(p), cubic = p[CUBIC_NM_RAD3];
    if (p[GAP_RAD] <= 0.0)
        return (k + cubic * twist * twist) * twist + d * twist_speed + CURVE(RESIDUAL_WIND_UP, twist).value;
    const double wound = fabs(twist) - 0.5 * p[GAP_RAD], side = twist > 0.0 ? 1.0 : -1.0;
    if (wound <= 0.0) return 0.0;
    return side * larger((k + cubic * wound * wound) * wound + d * side * twist_speed, 0.0)
           + CURVE(RESIDUAL_WIND_UP, side * wound).value;
}

/* To which angle an angle of the motor drives the coupling, and by how much further with each radian more. */
static Point driven(const double *p, double angle) {
    const double order = p[KINEMATIC_ORDER];
    const double once = order * angle + p[KINEMATIC_PHASE_RAD];
    const double twice = 2.0 * order * angle + p[KINEMATIC_SECOND_PHASE_RAD];
    Point point;
    point.value = angle + p[KINEMATIC_RAD] * sin(once) + p[KINEMATIC_SECOND_RAD] * sin(twice);
    point.slope = 1.0 + order * (p[KINEMATIC_RAD] * cos(once) + 2.0 * p[KINEMATIC_SECOND_RAD] * cos(twice));
    return point;
}

static Masses rates(const double *p, Masses s, double torque, double time) {
    const Point inertia = load_inertia(p, s.load_angle);
    double load = load_torque(p, s.load_angle, time - p[MOTION_START_S]);
    load -= p[LOAD_VISCOUS_FRICTION_NMS] * s.load_speed + 0.5 * inertia.slope * s.load_speed * s.load_speed;
    load -= (p[LOAD_VISCOUS_NMS] + p[LOAD_DRAG_NMS2] * fabs(s.load_speed)) * s.load_speed;
    Masses r = {s.motor_speed, 0.0, s.load_speed, 0.0, s.third_speed, 0.0, 0.0, 0.0, 0.0};
    double driving = torque;
    if (p[TORQUE_FADE] != 0.0) {
        const double share = torque / p[TORQUE_FADE_AT_NM];
        r.heat = (share * share - s.heat) / p[TORQUE_FADE_S];
        driving *= 1.0 - smaller(p[TORQUE_FADE] * s.heat, 1.0);
    }
    if (p[PRESLIDING_NM] > 0.0)
        r.bristles = p[PRESLIDING_STIFFNESS_NM_RAD]
                     * (s.motor_speed - fabs(s.motor_speed) * s.bristles / p[PRESLIDING_NM]);
    if (p[THIRD_INERTIA_KGM2] > 0.0) {
        const double passed = third_stiffness(p, s.load_speed) * (s.load_angle - s.third_angle)
                              + p[THIRD_DAMPING_NMS] * (s.load_speed - s.third_speed);
        load -= passed;
        r.third_speed = passed / p[THIRD_INERTIA_KGM2];
    }
    double motor = driving - p[MOTOR_VISCOUS_FRICTION_NMS] * s.motor_speed - s.bristles
                   + motor_torque(p, s.motor_angle, s.motor_speed, time);
    const double ahead = tanh(s.motor_speed / p[SMOOTHING_RAD_S]), load_ahead = tanh(s.load_speed / p[SMOOTHING_RAD_S]);
    motor += SIDED(RESIDUAL_POSITION, s.motor_angle, ahead) + SIDED(RESIDUAL_SPEED, fabs(s.motor_speed), ahead);
    motor += SIDED(RESIDUAL_TORQUE, fabs(torque), ahead) + SIDED(RESIDUAL_RUN, p[SESSION_SHARE], ahead);
    load += PLANE(RESIDUAL_POSITION_SPEED_PLANE, s.load_angle, s.load_speed);
    motor += PLANE(RESIDUAL_POSITION_TORQUE_PLANE, s.motor_angle, torque);
    motor += PLANE(RESIDUAL_TORQUE_TIME_IN_MOTION_PLANE, torque, time - p[MOTION_START_S]);
    motor += driving * p[RIPPLE_SHARE] * sin(p[RIPPLE_ORDER] * s.motor_angle + p[RIPPLE_PHASE_RAD]);
    load += SIDED(RESIDUAL_LOAD_POSITION, s.load_angle, load_ahead) - p[LOAD_COULOMB_NM] * load_ahead;
    if (RIGID) {
        const double lost = p[CARRIED_SHARE] * ahead * inertia.value;
        const double whole = rotor_inertia(p) + inertia.value + (motor + load > 0.0 ? lost : -lost);
        r.motor_speed = r.load_speed = accelerated(motor + load, whole);
    } else {
        const Point by = driven(p, s.motor_angle);
        const double twist = by.value - s.load_angle;
        const double twist_speed = by.slope * s.motor_speed - s.load_speed;
        double shaft = coupling_torque(p, s.motor_angle, twist, twist_speed);
        if (p[HYSTERESIS_NM] > 0.0 && fabs(twist) >= 0.5 * p[GAP_RAD]) {
            shaft += s.yielding;
            r.yielding = p[HYSTERESIS_STIFFNESS_NM_RAD] * twist_speed;
            if (s.yielding * twist_speed > 0.0)
                r.yielding *= 1.0 - pow(fabs(s.yielding) / p[HYSTERESIS_NM], p[HYSTERESIS_EXPONENT]);
        }
        r.motor_speed = (motor - by.slope * shaft - p[CARRIED_SHARE] * fabs(shaft) * ahead) / rotor_inertia(p);
        r.load_speed = accelerated(load + shaft, inertia.value);
    }
    return r;
}

static Masses moved(Masses s, Masses r, double by) {
    s.motor_angle += by * r.motor_angle;
    s.motor_speed += by * r.motor_speed;
    s.load_angle += by * r.load_angle;
    s.load_speed += by * r.load_speed;
    s.third_angle += by * r.third_angle;
    s.third_speed += by * r.third_speed;
    s.bristles += by * r.bristles;
    s.yielding += by * r.yielding;
    s.heat += by * r.heat;
    return s;
}

/* What a torque that the drive reports makes of itself on the shaft, once its current loop has settled. */
static double shaft_torque(const double *p, double reported) {
    const double drop = p[TORQUE_DROP] * pow(fabs(reported) / p[TORQUE_DROP_AT_NM], p[TORQUE_DROP_ORDER]);
    const double gain = p[TORQUE_GAIN] - drop;
    return smaller(larger(gain * reported, -p[TORQUE_LIMIT_NM]), p[TORQUE_LIMIT_NM]);
}

/* What the drive reports for a torque on the shaft, as near as it comes. */
static double reported_torque(const double *p, double held) {
    const double gain = p[TORQUE_GAIN], order = p[TORQUE_DROP_ORDER], wanted = fabs(held) / gain;
    if (p[TORQUE_DROP] == 0.0) return held / gain;
    const double most = p[TORQUE_DROP_AT_NM] * pow(gain / p[TORQUE_DROP] / (order + 1.0), 1.0 / order);
    double found = wanted;
    for (int i = 0; i < REPORTED_STEPS; i++) { /* Newton's, from below */
        const double drop = p[TORQUE_DROP] * pow(found / p[TORQUE_DROP_AT_NM], order);
        const double slope = gain - (order + 1.0) * drop;
        if (found >= most || slope <= 0.0) break;
        found += (gain * wanted - (gain - drop) * found) / slope;
    }
    return (held < 0.0 ? -1.0 : 1.0) * smaller(found, most);
}

/* Steps over a duration, from the fastest thing that the machine does. */
static double steps_needed(const Machine *m, double duration) {
    const double *p = m->value;
    const double speed = fabs(m->state.motor_speed), lightest = lightest_load(p);
    double mass = rotor_inertia(p), fastest = 0.0;
    if (RIGID) {
        mass += lightest;
    } else {
        const double mobility = 1.0 / mass + 1.0 / lightest, twist = m->state.motor_angle - m->state.load_angle;
        const double stiff = stiffness(p) * (1.0 + fabs(p[STIFFNESS_SHARE])) + 3.0 * larger(p[CUBIC_NM_RAD3], 0.0) * twist * twist
                             + larger(CURVE(RESIDUAL_WIND_UP, twist).slope, 0.0);
        fastest = larger(sqrt(stiff * mobility), damping(p) * mobility);
    }
    if (p[THIRD_INERTIA_KGM2] > 0.0) {
        const double mobility = 1.0 / p[THIRD_INERTIA_KGM2] + 1.0 / (RIGID ? mass : lightest);
        const double swing = sqrt(third_stiffness(p, m->state.load_speed) * mobility);
        fastest = hypot(fastest, larger(swing, p[THIRD_DAMPING_NMS] * mobility));
    }
    const double step = p[GAP_RAD] > 0.0 ? CONTACT_STEP : COUPLING_STEP;
    const double end = larger(p[END_HIGH_NM_RAD], p[END_LOW_NM_RAD]);
    if (end > 0.0) {
        const double met = sqrt(end / (RIGID ? mass : lightest));
        fastest = larger(hypot(fastest, met), met * step / CONTACT_STEP);
    }
    for (int wave = 1; wave <= 2; wave++) {
        const double amplitude = p[wave == 1 ? COGGING_AMPLITUDE_NM : COGGING_SECOND_NM];
        const double order = wave * p[COGGING_ORDER];
        if (amplitude != 0.0)
            fastest = larger(fastest, larger(sqrt(fabs(amplitude) * order * order / mass), order * speed));
    }
    if (p[RIPPLE_SHARE] != 0.0) fastest = larger(fastest, p[RIPPLE_ORDER] * speed);
    if (p[STIFFNESS_SHARE] != 0.0) fastest = larger(fastest, p[STIFFNESS_ORDER] * speed);
    if (p[KINEMATIC_RAD] != 0.0) fastest = larger(fastest, p[KINEMATIC_ORDER] * speed);
    if (p[KINEMATIC_SECOND_RAD] != 0.0) fastest = larger(fastest, 2.0 * p[KINEMATIC_ORDER] * speed);
    if (p[PERIODIC_AMPLITUDE_NM] != 0.0) fastest = larger(fastest, TWO_PI * p[PERIODIC_FREQUENCY_HZ]);
    if (p[PRESLIDING_NM] > 0.0) fastest = larger(fastest, sqrt(p[PRESLIDING_STIFFNESS_NM_RAD] / mass));
    double dry = larger(p[COULOMB_POSITIVE_NM], p[COULOMB_NEGATIVE_NM]) + drift(p);
    dry = larger(dry + larger(p[STRIBECK_RISE_NM], 0.0) + larger(p[LOCAL_FRICTION_NM], 0.0), 0.0);
    double rubbing = p[MOTOR_VISCOUS_FRICTION_NMS] + 2.0 * fabs(p[DRAG_NMS2]) * speed;
    rubbing += larger(p[VISCOUS_NMS] + 0.5 * fabs(p[VISCOUS_DIFFERENCE_NMS]), 0.0);
    rubbing += p[SESSION_SHARE] * larger(p[VISCOUS_DRIFT_NMS], 0.0);
    dry += HIGHEST(RESIDUAL_POSITION) + HIGHEST(RESIDUAL_SPEED) + HIGHEST(RESIDUAL_TORQUE) + HIGHEST(RESIDUAL_RUN);
    dry += p[CARRIED_SHARE] * fabs(p[TORQUE]);
    double behind = (HIGHEST(RESIDUAL_LOAD_POSITION) + p[LOAD_COULOMB_NM]) / p[SMOOTHING_RAD_S];
    behind += larger(p[LOAD_VISCOUS_NMS], 0.0) + 2.0 * fabs(p[LOAD_DRAG_NMS2]) * speed;
    rubbing = larger((rubbing + dry / p[SMOOTHING_RAD_S]) / mass, behind / lightest);
    rubbing += steepest(&RESIDUAL_POSITION_SPEED_PLANE[0][0], HIGH(RESIDUAL_POSITION_SPEED_PLANE),
                        WIDE(RESIDUAL_POSITION_SPEED_PLANE)) / lightest;
    if (p[TORQUE_FADE] > 0.0) rubbing = larger(rubbing, 1.0 / p[TORQUE_FADE_S]);
    if (p[PRESLIDING_NM] > 0.0)
        rubbing = larger(rubbing, speed * p[PRESLIDING_STIFFNESS_NM_RAD] / p[PRESLIDING_NM]);
    const double needed = larger(duration * fastest / step, duration * rubbing / FRICTION_STEP);
    return ceil(larger(larger(needed, duration / LONGEST_STEP), 1.0));
}

static const char *impossible(const double *p) {
    for (int i = 0; i < N_VARIABLES; i++)
        if (!isfinite(p[i])) return "a parameter or the torque is not a finite number";
    if (!(p[MOTOR_INERTIA_KGM2] > 0.0)) return "motor_inertia_kgm2 is not positive";
    if (!(lightest_load(p) > 0.0)) return "the load's inertia is not positive: correct inertia_scale or inertia_delta_kgm2";
    if (!RIGID && !(stiffness(p) > 0.0)) return "coupling_stiffness_nm_rad is not positive";
    if (!(p[SMOOTHING_RAD_S] > 0.0)) return "smoothing_rad_s is not positive";
    if (!(p[TORQUE_GAIN] > 0.0)) return "torque_gain is not positive";
    if (!(p[TORQUE_DROP_AT_NM] > 0.0)) return "torque_drop_at_nm is not positive";
    if (!(p[TORQUE_DROP_ORDER] > 0.0)) return "torque_drop_order is not positive";
    if (!(p[TORQUE_FADE_AT_NM] > 0.0)) return "torque_fade_at_nm is not positive";
    if (!(p[TORQUE_FADE_S] > 0.0)) return "torque_fade_s is not positive";
    if (!(p[TORQUE_LAG_S] >= 0.0 && p[SPEED_DELAY_S] >= 0.0)) return "torque_lag_s or speed_delay_s is negative";
    if (!(fabs(p[ECCENTRICITY_RAD]) <= 0.5)) return "eccentricity_rad is beyond 0.5";
    if (!(fabs(p[HARMONIC_RAD] * p[HARMONIC_ORDER]) <= 0.5)) return "harmonic_rad times harmonic_order is beyond 0.5";
    return NULL;
}

/* The angle that the drive reads at one of the motor. */
static double read_angle(const double *p, double angle) {
    return angle + p[ECCENTRICITY_RAD] * sin(angle + p[ECCENTRICITY_PHASE_RAD])
           + p[HARMONIC_RAD] * sin(p[HARMONIC_ORDER] * angle + p[HARMONIC_PHASE_RAD]);
}

/* The angle of the motor at which the drive reads this one, which only grows with it: by halving. */
static double angle_of(const double *p, double read) {
    const double most = fabs(p[ECCENTRICITY_RAD]) + fabs(p[HARMONIC_RAD]);
    double low = read - most, high = read + most;
    for (int i = 0; i < 100; i++) {
        const double middle = 0.5 * (low + high);
        if (read_angle(p, middle) < read) low = middle; else high = middle;
    }
    return 0.5 * (low + high);
}

/* The speed that the drive would read at once. */
static double read_speed(const Machine *m) {
    const double *p = m->value;
    const double angle = m->state.motor_angle, many = p[HARMONIC_ORDER];
    return m->state.motor_speed * (1.0 + p[ECCENTRICITY_RAD] * cos(angle + p[ECCENTRICITY_PHASE_RAD])
                                   + p[HARMONIC_RAD] * many * cos(many * angle + p[HARMONIC_PHASE_RAD]));
}

static int past(const Machine *m, int i) { return (m->past_first + i) % PAST; }

/* Remember the speed, no closer than a delay needs. */
static void remember(Machine *m) {
    const double apart = m->value[SPEED_DELAY_S] * 2.0 / PAST;
    if (m->past_count > 1 && m->past_time[past(m, m->past_count - 1)] - m->past_time[past(m, m->past_count - 2)] < apart)
        m->past_count--;
    if (m->past_count == PAST) {
        m->past_first = past(m, 1);
        m->past_count--;
    }
    const int at = past(m, m->past_count++);
    m->past_time[at] = m->time;
    m->past_speed[at] = read_speed(m);
}

/* The speed as the drive reads it: straight between communication points; before the first it stood as then. */
static double late_speed(const Machine *m) {
    const double then = m->time - m->value[SPEED_DELAY_S];
    if (m->past_count == 0 || m->value[SPEED_DELAY_S] <= 0.0) return read_speed(m);
    if (then <= m->past_time[past(m, 0)]) return m->past_speed[past(m, 0)];
    int low = 0, high = m->past_count - 1;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (then < m->past_time[past(m, middle)]) high = middle; else low = middle;
    }
    const double begin = m->past_time[past(m, low)], end = m->past_time[past(m, high)];
    const double share = end > begin ? (then - begin) / (end - begin) : 1.0;
    return (1.0 - share) * m->past_speed[past(m, low)] + share * m->past_speed[past(m, high)];
}

void machine_reset(Machine *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->value, START, sizeof m->value);
}

/* What acts on the load at rest, before anything moves. */
static double resting_load(const double *p, double angle) {
    return load_torque(p, angle, -1e300) + CURVE(RESIDUAL_ACCELERATION, 0.0).value
           + PLANE(RESIDUAL_POSITION_SPEED_PLANE, angle, 0.0);
}

/* What would turn the load from this angle on, the motor standing. */
static double pull(const double *p, double motor_angle, double load_angle) {
    return resting_load(p, load_angle) + coupling_torque(p, motor_angle, driven(p, motor_angle).value - load_angle, 0.0);
}

static const char *wind_up(const double *p, double motor_angle, double *load_angle) {
    const double unwound = driven(p, motor_angle).value;
    const double begin = pull(p, motor_angle, unwound), towards = begin > 0.0 ? 1.0 : -1.0;
    *load_angle = RIGID ? motor_angle : unwound;
    if (RIGID || begin == 0.0) return NULL;
    double near = 0.0, far = 0.5 * p[GAP_RAD] + 1e-3 * fabs(resting_load(p, unwound)) / stiffness(p);
    while (pull(p, motor_angle, unwound + towards * far) * towards > 0.0) {
        far *= 2.0;
        if (far > 100.0) return "coupling_stiffness_nm_rad is too low to bear the load's torque";
    }
    for (int i = 0; i < 200; i++) {
        const double middle = 0.5 * (near + far);
        if (pull(p, motor_angle, unwound + towards * middle) * towards > 0.0) near = middle; else far = middle;
    }
    *load_angle = unwound + towards * 0.5 * (near + far);
    return NULL;
}

const char *machine_rest(Machine *m, double time) {
    const double *p = m->value;
    const char *wrong = impossible(p);
    if (wrong) return wrong;
    double load;
    const double angle = angle_of(p, p[START_ANGLE_RAD]);
    wrong = wind_up(p, angle, &load);
    if (wrong) return wrong;
    m->time = time;
    m->state = (Masses){angle, 0.0, load, 0.0, load, 0.0, 0.0, 0.0, p[TORQUE_FADE_START]};
    double held = -(RIGID ? 1.0 : driven(p, angle).slope) * resting_load(p, load) - p[OFFSET_NM] - p[SESSION_SHARE] * p[OFFSET_DRIFT_NM];
    held -= cogging(p, angle);
    double share = 1.0 + p[RIPPLE_SHARE] * sin(p[RIPPLE_ORDER] * angle + p[RIPPLE_PHASE_RAD]);
    share *= 1.0 - smaller(p[TORQUE_FADE] * p[TORQUE_FADE_START], 1.0);
    double on_shaft = held / share;
    for (int i = 0; i < 200; i++) /* what depends on the torque does so by less than all of it */
        on_shaft = (held - PLANE(RESIDUAL_POSITION_TORQUE_PLANE, angle, on_shaft)
                    - PLANE(RESIDUAL_TORQUE_TIME_IN_MOTION_PLANE, on_shaft, -1e300)) / share;
    m->acting = shaft_torque(p, reported_torque(p, on_shaft));
    m->past_first = m->past_count = 0;
    remember(m);
    m->initialised = 1;
    return NULL;
}

const char *machine_step(Machine *m, double duration) {
    const double *p = m->value;
    const char *wrong = impossible(p);
    if (wrong) return wrong;
    if (!(duration >= 0.0 && isfinite(duration))) return "the step's length is negative, or no number";
    const double count = steps_needed(m, duration);
    if (count > MOST_STEPS) return "the machine is too fast to be simulated: check stiffness, inertias and the step";
    const double step = duration / count, wanted = shaft_torque(p, p[TORQUE]), lag = p[TORQUE_LAG_S];
    /* The lag is solved exactly; the middle stages get what makes Simpson's rule the true mean over the step. */
    const double decay = lag > 0.0 && step > 0.0 ? exp(-step / lag) : 0.0;
    const double middle = lag > 0.0 && step > 0.0 ? (6.0 * (1.0 - decay) * lag / step - 1.0 - decay) / 4.0 : 0.0;
    double behind = lag > 0.0 ? m->acting - wanted : 0.0;
    Masses s = m->state;
    for (long i = 0; i < (long)count && duration > 0.0; i++) {
        const double begin = m->time + (double)i * step, halfway = wanted + behind * middle;
        const Masses k1 = rates(p, s, wanted + behind, begin);
        const Masses k2 = rates(p, moved(s, k1, step / 2.0), halfway, begin + step / 2.0);
        const Masses k3 = rates(p, moved(s, k2, step / 2.0), halfway, begin + step / 2.0);
        behind *= decay;
        const Masses k4 = rates(p, moved(s, k3, step), wanted + behind, begin + step);
        s = moved(moved(moved(moved(s, k1, step / 6.0), k2, step / 3.0), k3, step / 3.0), k4, step / 6.0);
    }
    if (!isfinite(s.motor_angle + s.motor_speed + s.load_angle + s.load_speed + s.third_angle + s.third_speed))
        return "the motion does not stay finite";
    m->state = s;
    m->acting = wanted + behind;
    m->time += duration;
    remember(m);
    return NULL;
}

void machine_outputs(Machine *m) {
    double *v = m->value;
    const Masses *s = &m->state;
    v[TIME] = m->time;
    v[MOTOR_ANGLE] = read_angle(v, s->motor_angle);
    v[MOTOR_SPEED] = late_speed(m);
    v[LOAD_ANGLE] = s->load_angle;
    v[LOAD_SPEED] = s->load_speed;
}
