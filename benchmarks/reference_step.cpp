// SPDX-License-Identifier: Apache-2.0
// Measure the time of a step of the reference actuator in scalar C++.
// g++ -O3 -march=native [-ffast-math] reference_step.cpp -o reference_step && ./reference_step
//
// The steps are equations (M1) to (M8) of docs/model.md, as in ema_sim/reference.py, for the built-in
// actuator. From rest, it follows a chirp of 5 mrad from 0 to 15 Hz in 0.5 s, in steps of 1 us. There are
// two cases: healthy, and faulty with eccentricity 0.3, a short circuit of 20 % in phase A, and friction
// 1.5 times nominal.
// Prints a line per case: name, shortest and median time of a step [ns]. With --current, prints the
// equivalent current [A] instead, first healthy and then faulty: a line per sample of 100 us.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <vector>

namespace {

const double PI = std::acos(-1.0), THIRD = 2 * PI / 3, SIN_THIRD = std::sqrt(0.75);
const double DT = 1e-6, LAG = -std::expm1(-DT / 1e-5);
const int SAMPLES = 5000, STEPS = 100, REPEATS = 9;

struct Actuator {
  double G_prop = 1e5, GAP = 0.05, GAI = 0, GAD = 0, omega_max = 8000 * 2 * PI / 60;
  double k_t = 0.0752, I_max = 22.5, V_max = 48, T_max = 1.689, k_e = 0.0752;
  double R_s = 2.13, L_s = 7.2e-4, P = 2, h_b = 0.5, N_a = 1, N_b = 1, N_c = 1, zeta = 0, phi = 0;
  double J = 2.5e-5, C = 30e-6 / PI + 4.5e-7, f_s = 0.1 * 1.689, f_d = 0.05 * 1.689;
  double half_backlash = 2.5e-3, tau = 1.0 / 500, theta_stop = 600;
};

struct State {
  double theta_m = 0, omega = 0, theta_b = 0, i_a = 0, i_b = 0, i_c = 0, q_a = 1, q_b = 1, q_c = 1;
  double lag_1 = 0, lag_2 = 0, lag_3 = 0, integral = 0, error = 0, torque = 0;
};

double clip(double x, double limit) { return std::min(std::max(x, -limit), limit); }
double sign(double x) { return double(x > 0) - double(x < 0); }

double trapezoid(double theta_e) {
  double turn = theta_e * (1 / (2 * PI)) + 0.25;
  turn -= std::floor(turn);
  return 12 * (0.25 - std::fabs(turn - 0.5));
}

double commutation(double shape) { return double(shape > 1) - double(shape < -1); }

double hysteresis(double switched, double current, double target, double h_b) {
  return current < target - h_b ? 1 : current > target + h_b ? -1 : switched;
}

inline State step(const Actuator& p, const State& x, double command, double load) {
  double error = clip(p.G_prop * (command - x.theta_b * p.tau), p.omega_max) - x.omega;
  double torque_ref = p.GAP * error + p.GAI * x.integral + p.GAD / DT * (error - x.error);
  double I_ref = clip(torque_ref * (1 / p.k_t), p.I_max);

  double theta_e = p.P * x.theta_m;
  double shape_a = trapezoid(theta_e);
  double shape_b = trapezoid(theta_e - THIRD);
  double shape_c = trapezoid(theta_e - 2 * THIRD);
  double q_a = hysteresis(x.q_a, x.i_a, I_ref * commutation(shape_a), p.h_b);
  double q_b = hysteresis(x.q_b, x.i_b, I_ref * commutation(shape_b), p.h_b);
  double q_c = hysteresis(x.q_c, x.i_c, I_ref * commutation(shape_c), p.h_b);

  double k_a = 0.5 * p.k_e * p.N_a * clip(shape_a, 1);
  double k_b = 0.5 * p.k_e * p.N_b * clip(shape_b, 1);
  double k_c = 0.5 * p.k_e * p.N_c * clip(shape_c, 1);
  if (p.zeta != 0) {
    double along = p.zeta * std::cos(x.theta_m + p.phi);
    double across = p.zeta * SIN_THIRD * std::sin(x.theta_m + p.phi);
    k_a *= 1 + along;
    k_b *= 1 - 0.5 * along - across;
    k_c *= 1 - 0.5 * along + across;
  }

  double R = 0.5 * p.R_s, L = 0.5 * p.L_s, V = 0.5 * p.V_max;
  double inverse_a = 1 / (L * p.N_a * p.N_a);
  double inverse_b = 1 / (L * p.N_b * p.N_b);
  double inverse_c = 1 / (L * p.N_c * p.N_c);
  double v_a = V * q_a - R * p.N_a * x.i_a - k_a * x.omega;
  double v_b = V * q_b - R * p.N_b * x.i_b - k_b * x.omega;
  double v_c = V * q_c - R * p.N_c * x.i_c - k_c * x.omega;
  double parallel = 1 / (inverse_a + inverse_b + inverse_c);
  double v_n = (v_a * inverse_a + v_b * inverse_b + v_c * inverse_c) * parallel;
  double i_a = x.i_a + DT * inverse_a * (v_a - v_n);
  double i_b = x.i_b + DT * inverse_b * (v_b - v_n);
  double i_c = x.i_c + DT * inverse_c * (v_c - v_n);

  double torque = clip(k_a * i_a + k_b * i_b + k_c * i_c, p.T_max);
  double equivalent = 0.5 * sign(torque) * (std::fabs(i_a) + std::fabs(i_b) + std::fabs(i_c));
  double lag_1 = x.lag_1 + LAG * (equivalent - x.lag_1);
  double lag_2 = x.lag_2 + LAG * (lag_1 - x.lag_2);
  double lag_3 = x.lag_3 + LAG * (lag_2 - x.lag_3);

  double net = torque - load - p.C * x.omega, omega;
  if (x.omega == 0) {
    omega = std::fabs(net) <= p.f_s ? 0 : DT / p.J * (net - std::copysign(p.f_d, net));
  } else {
    omega = x.omega + DT / p.J * (net - std::copysign(p.f_d, x.omega));
    if (omega * x.omega < 0) omega = 0;
  }
  double theta_m = x.theta_m + DT * omega;
  if (std::fabs(theta_m) > p.theta_stop) {
    theta_m = std::copysign(p.theta_stop, theta_m);
    omega = 0;
  }
  double theta_b = std::min(std::max(x.theta_b, theta_m - p.half_backlash), theta_m + p.half_backlash);
  return {theta_m, omega, theta_b, i_a, i_b, i_c, q_a, q_b, q_c,
          lag_1, lag_2, lag_3, x.integral + DT * error, error, torque};
}

// Not inlined, so that the compiler cannot treat the actuator's parameters as constants.
__attribute__((noinline)) void advance(
    const Actuator& actuator, const double* commands, const double* loads, double* current) {
  const Actuator p = actuator;
  State x;
  double last_command = 0, last_load = 0;
  for (int k = 0; k < SAMPLES; k++) {
    double rise = (commands[k] - last_command) / STEPS, load_rise = (loads[k] - last_load) / STEPS;
    double total = 0;
    for (int j = 0; j < STEPS; j++) {
      x = step(p, x, last_command + j * rise, last_load + j * load_rise);
      total += x.lag_3;
    }
    last_command = commands[k];
    last_load = loads[k];
    current[k] = total / STEPS;
  }
}

double now_ns() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1e9 + t.tv_nsec;
}

}  // namespace

int main(int argc, char**) {
  std::vector<double> commands(SAMPLES), loads(SAMPLES), current(SAMPLES);
  for (int k = 0; k < SAMPLES; k++) {
    double t = 1e-4 * (k + 1);
    commands[k] = 0.005 * std::sin(2 * PI * 15 * t * t / (2 * 0.5));
  }
  Actuator healthy, faulty;
  faulty.zeta = 0.3;
  faulty.N_a = 0.8;
  faulty.f_s *= 1.5;
  faulty.f_d *= 1.5;
  for (const auto& [name, actuator] : {std::pair{"healthy", healthy}, {"faulty", faulty}}) {
    std::vector<double> ns;
    for (int n = 0; n < REPEATS; n++) {
      double start = now_ns();
      advance(actuator, commands.data(), loads.data(), current.data());
      ns.push_back((now_ns() - start) / SAMPLES / STEPS);
    }
    std::sort(ns.begin(), ns.end());
    if (argc == 1) std::printf("%s %.3f %.3f\n", name, ns[0], ns[REPEATS / 2]);
    if (argc > 1) for (double i : current) std::printf("%.17g\n", i);
  }
}
