/* The machine: motor, coupling and load with an inertia over its angle, and all physics that Schwung knows by name.
 * SI units. The equations are those of schwung/drivetrain/learned.py; a parameter that was not learned is neutral. */
#ifndef SCHWUNG_MACHINE_H
#define SCHWUNG_MACHINE_H

#include "machine_data.h" /* written for one machine: variables by number, their values at first, tables */

enum { PAST = 2048 };

typedef struct {
    double motor_angle, motor_speed, load_angle, load_speed, third_angle, third_speed;
    double bristles; /* what bent bristles hold, N.m */
    double yielding; /* what yields in the coupling, N.m */
    double heat;     /* of the motor, 1 where the torque that its fading is told at lasts */
} Masses;

typedef struct {
    double value[N_VARIABLES]; /* parameters, input and outputs, by value reference */
    double time;
    int initialised;
    Masses state;
    double acting;                               /* shaft torque behind the lag, N.m */
    double past_time[PAST], past_speed[PAST];    /* speeds as read, for a drive that reads them late */
    int past_first, past_count;
} Machine;

/* Everything as at first: values of the file, time 0. */
void machine_reset(Machine *machine);

/* Standstill at start_angle, wound up by what acts on the load. Returns what is wrong, or NULL. */
const char *machine_rest(Machine *machine, double time);

/* So much further (s) with the torque held. Returns what is wrong, or NULL; then the state is as it was. */
const char *machine_step(Machine *machine, double duration);

/* Work the outputs out. */
void machine_outputs(Machine *machine);

#endif
