#include "screw.h"

#include <math.h>

#define TWO_PI 6.28318531F
#define OBSERVER_RAD_S 100.0F

/// Below this speed of a finger dry friction may point either way.
#define STANDING_M_S 2.0e-4F

/// A squeeze within this share of the one wanted is reached: the motor may rest.
#define REACHED 0.97F

void crux_screw_init(crux_screw *screw, const crux_screw_parameters *parameters) {
  *screw = (crux_screw){.parameters = *parameters};
}

/// c of the header: torque that builds a squeeze, per newton of it.
static float build_Nm_N(const crux_screw *screw) {
  return (2.0F * screw->parameters.lead_m) / (TWO_PI * screw->parameters.efficiency);
}

void crux_screw_observe(crux_screw *screw, float dt_s, float rotor_torque_Nm, float rotor_speed_rad_s) {
  const crux_screw_parameters *parameters = &screw->parameters;
  const float drag_Nm = parameters->drag_Nms_rad * rotor_speed_rad_s;
  screw->momentum_Nms += dt_s * (rotor_torque_Nm - drag_Nm - screw->load_Nm);
  screw->load_Nm = OBSERVER_RAD_S * (screw->momentum_Nms - (parameters->inertia_kg_m2 * rotor_speed_rad_s));

  const float finger_m_s = (rotor_speed_rad_s * parameters->lead_m) / TWO_PI;
  const float building_N = screw->load_Nm / build_Nm_N(screw);
  const float releasing_N = -building_N / parameters->release_torque;
  if (finger_m_s > STANDING_M_S) {
    screw->force_N = fmaxf(building_N, 0.0F);
  } else if (finger_m_s < -STANDING_M_S) {
    screw->force_N = fmaxf(releasing_N, 0.0F);
  } else {
    // Neither yields: the squeeze is no less than either torque could move.
    screw->force_N = fmaxf(screw->force_N, fmaxf(building_N, releasing_N));
  }
}

float crux_screw_rotor_torque_Nm(crux_screw *screw, float force_N, bool may_release) {
  const float build = build_Nm_N(screw);
  const float efficiency = screw->parameters.efficiency;
  float torque_Nm = 0.0F;
  screw->braked = false;
  if ((force_N > 0.0F) && (screw->force_N < (REACHED * force_N))) {
    torque_Nm = build * ((efficiency * force_N) + ((1.0F - efficiency) * screw->force_N));
  } else if (may_release && (force_N < 0.0F)) {
    torque_Nm = build * ((efficiency * force_N) - (screw->parameters.release_torque * screw->force_N));
  } else {
    screw->braked = true;
  }
  return torque_Nm;
}
