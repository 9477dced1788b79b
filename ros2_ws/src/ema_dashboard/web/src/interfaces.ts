// Written by `make page` of the definitions of the messages.

export interface ActuatorDescription {
  header: Header;
  actuator_id: string;
  serial_number: string;
  model: string;
  sample_period: number;
  current_sampling: number;
  current_filter_time: number;
  speed_measured: boolean;
  has_command: boolean;
  effort_kind: number;
  drive: number;
  position_gain: number;
  speed_p: number;
  speed_i: number;
  speed_d: number;
  speed_reference_limit: number;
  supply_voltage: number;
  current_limit: number;
  torque_limit: number;
  torque_constant: number;
  back_emf_constant: number;
  monitor_torque_gain: number;
  resistance: number;
  inductance: number;
  pole_pairs: number;
  current_hysteresis: number;
  current_bandwidth: number;
  motor_inertia: number;
  user_inertia: number;
  motor_viscous_damping: number;
  user_viscous_damping: number;
  motor_static_friction: number;
  user_static_friction: number;
  dynamic_friction_ratio: number;
  backlash: number;
  gear_ratio: number;
  end_stop: number;
  lead: number;
}

export interface Advice {
  header: Header;
  actuator_id: string;
  serial_number: string;
  action: number;
  flight_hours: number;
  from_now: number;
  probability_of_failure: number;
  expected_cost: number;
  cost_of_immediate_removal: number;
  cost_unit: string;
  reason: string;
}

export interface BaselineStatus {
  header: Header;
  actuator_id: string;
  serial_number: string;
  state: number;
  records: number;
  records_needed: number;
  days: number;
  slowest: number;
  fastest: number;
  forward_share: number;
  detectable_same_day: number;
  detectable_other_day: number;
  advice: string[];
  reason: string;
  calibration_id: string;
  author: string;
  accepted: Time;
}

export interface Confusion {
  part: string[];
  stand_in: string[];
}

export interface DiagnosticArray {
  header: Header;
  status: DiagnosticStatus[];
}

export interface DiagnosticStatus {
  level: number;
  name: string;
  message: string;
  hardware_id: string;
  values: KeyValue[];
}

export interface FaultEstimate {
  header: Header;
  actuator_id: string;
  serial_number: string;
  window: bigint;
  window_start: Time;
  window_end: Time;
  stretches: number;
  faults: FaultVector;
  covariance: Float64Array;
  quantiles: Float64Array;
  probability: Float64Array;
  unobservable: number;
  insignificant: number;
  play_offset: number;
  fitness: number;
  goodness_of_fit: number;
  goodness_limit: number;
  unexplained_share: number;
  causes: HiddenCause[];
  measured: HiddenCause[];
  quantities: QuantityChange[];
  alternatives: Confusion[];
  verdict: number;
  excitation: number;
  excitation_limit: number;
  algorithm: string;
  seed: bigint;
  evaluations: bigint;
  warm_start: boolean;
  computing_time: number;
  calibration_id: string;
  calibration_windows: bigint;
  lacks_calibration: boolean;
  valid: boolean;
  reason: string;
  reason_codes: string[];
}

export interface FaultForecast {
  name: string;
  limit: number;
  values: Float64Array;
}

export interface FaultHealth {
  name: string;
  level: number;
  value: number;
  sigma: number;
  limit: number;
  limit_is_lower: boolean;
  trend: number;
  calibration: number;
  calibration_ahead: number;
  widening: number;
  unit: string;
  rul: RemainingUsefulLife;
}

export type FaultVector = Record<string, number>;

export interface FrictionCurve {
  header: Header;
  actuator_id: string;
  serial_number: string;
  unit: string;
  speed: Float64Array;
  healthy_low: Float64Array;
  healthy_high: Float64Array;
  latest: Float64Array;
}

export interface Header {
  stamp: Time;
  frame_id: string;
}

export interface Health {
  header: Header;
  actuator_id: string;
  serial_number: string;
  level: number;
  last_level: number;
  measured: Time;
  received: Time;
  good_until: Time;
  author: string;
  health_index: number;
  severity: number;
  confidence: number;
  dominant_fault: string;
  faults: FaultHealth[];
  requirements: FaultHealth[];
  rul_faults: RemainingUsefulLife;
  rul_requirements: RemainingUsefulLife;
  rul: RemainingUsefulLife;
  flight_hours: number;
  cycles: bigint;
  duty: number;
  assumption: string;
  cause: string;
  removal: string;
  removal_risk: number;
  removal_hours: number;
  removal_cycles: number;
  removal_days: number;
  events: UnitEvent[];
  reason: string;
}

export interface HealthForecast {
  header: Header;
  actuator_id: string;
  serial_number: string;
  flight_hours: number;
  duty: number;
  hours: Float64Array;
  probabilities: Float64Array;
  faults: FaultForecast[];
}

export interface HiddenCause {
  name: string;
  value: number;
  sigma: number;
  unit: string;
  alternatives: string[];
}

export interface KeyValue {
  key: string;
  value: string;
}

export interface PlaybackState {
  header: Header;
  bag: string;
  status: number;
  rate: number;
  start: Time;
  end: Time;
  position: Time;
  jumped: boolean;
}

export interface QuantityChange {
  name: string;
  judgement: number;
  change: number;
  low: number;
  high: number;
  smallest_change: number;
  unit: string;
  reason: string;
  rivals: string[];
}

export interface RemainingUsefulLife {
  known: boolean;
  hours_05: number;
  hours_50: number;
  hours_95: number;
  cycles_05: number;
  cycles_50: number;
  cycles_95: number;
  criterion: string;
  reason: string;
}

export interface TelemetryBlock {
  header: Header;
  actuator_id: string;
  sample_period: number;
  first_index: bigint;
  command: Float64Array;
  current: Float64Array;
  position: Float64Array;
  speed: Float64Array;
}

export interface Time {
  sec: number;
  nanosec: number;
}

export interface UnitEvent {
  stamp: Time;
  flight_hours: number;
  kind: string;
  text: string;
}

export interface UnitHistory {
  header: Header;
  actuator_id: string;
  serial_number: string;
  is_addition: boolean;
  tests: UnitTest[];
  events: UnitEvent[];
  omitted: bigint;
}

export interface UnitTest {
  stamp: Time;
  flight_hours: number;
  cycles: bigint;
  verdict: number;
  faults: Float64Array;
  sigmas: Float64Array;
  insignificant: number;
  level: number;
  health_index: number;
  dominant_fault: string;
  rul_known: boolean;
  rul_05: number;
  rul_50: number;
  rul_95: number;
}

export interface WindowFit {
  header: Header;
  actuator_id: string;
  window: bigint;
  verdict: number;
  period: number;
  start: number;
  command: Float32Array;
  position: Float32Array;
  current: Float32Array;
  estimated_current: Float32Array;
  speed: Float32Array;
  estimated_speed: Float32Array;
}
