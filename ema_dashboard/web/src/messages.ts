// The messages that the page reads, as decoded by @foxglove/rosmsg2-serialization. Units are
// those of the definitions in ema_interfaces/msg.

export interface Time {
  sec: number;
  nanosec: number;
}

export interface Header {
  stamp: Time;
  frame_id: string;
}

export const OK = 0;
export const WARN = 1;
export const ERROR = 2;
export const STALE = 3;

export interface RemainingLife {
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
  rul: RemainingLife;
}

interface OfUnit {
  header: Header;
  actuator_id: string;
  serial_number: string;
}

export interface Health extends OfUnit {
  level: number;
  health_index: number;
  severity: number;
  confidence: number;
  dominant_fault: string;
  faults: FaultHealth[];
  requirements: FaultHealth[];
  rul_faults: RemainingLife;
  rul_requirements: RemainingLife;
  rul: RemainingLife;
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

export const VERDICTS = ["valid", "degraded", "refused"] as const;

export interface HiddenCause {
  name: string;
  value: number;
  sigma: number;
  unit: string;
  alternatives: string[];
}

export interface FaultEstimate extends OfUnit {
  window: bigint;
  window_start: Time;
  window_end: Time;
  stretches: number;
  faults: Record<string, number>;
  covariance: Float64Array;
  unobservable: number;
  insignificant: number;
  goodness_of_fit: number;
  goodness_limit: number;
  unexplained_share: number;
  hidden_causes: HiddenCause[];
  measured_causes: HiddenCause[];
  confusions: string[];
  verdict: number;
  excitation: number;
  excitation_limit: number;
  algorithm: string;
  evaluations: bigint;
  warm_start: boolean;
  computing_time: number;
  calibration_id: string;
  calibration_windows: bigint;
  valid: boolean;
  reason: string;
}

export interface HealthForecast extends OfUnit {
  flight_hours: number;
  duty: number;
  hours: Float64Array;
  probabilities: Float64Array;
  faults: { name: string; limit: number; values: Float64Array }[];
}

export const ACTIONS = ["unknown", "continue", "inspect", "remove"] as const;

export interface Advice extends OfUnit {
  action: number;
  flight_hours: number;
  from_now: number;
  probability_of_failure: number;
  expected_cost: number;
  cost_of_immediate_removal: number;
  cost_unit: string;
  reason: string;
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

export interface UnitEvent {
  stamp: Time;
  flight_hours: number;
  kind: string;
  text: string;
}

export interface UnitTest {
  stamp: Time;
  flight_hours: number;
  cycles: bigint;
  verdict: number;
  faults: ArrayLike<number>;
  sigmas: ArrayLike<number>;
  insignificant: number;
  level: number;
  health_index: number;
  dominant_fault: string;
  rul_known: boolean;
  rul_05: number;
  rul_50: number;
  rul_95: number;
}

export interface UnitHistory extends OfUnit {
  is_addition: boolean;
  tests: UnitTest[];
  events: UnitEvent[];
  omitted: bigint;
}

export interface ActuatorDescription extends OfUnit {
  model: string;
  sample_period: number;
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

export const PLAYING = 0;
export const PAUSED = 1;
export const ENDED = 2;

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

export interface DiagnosticStatus {
  level: number;
  name: string;
  message: string;
  hardware_id: string;
  values: { key: string; value: string }[];
}

export interface DiagnosticArray {
  header: Header;
  status: DiagnosticStatus[];
}

/** Seconds since the epoch. */
export function seconds(time: Time): number {
  return time.sec + time.nanosec * 1e-9;
}

/** Nanoseconds since the epoch, exactly. */
export function nanoseconds(time: Time): bigint {
  return BigInt(time.sec) * 1_000_000_000n + BigInt(time.nanosec);
}
