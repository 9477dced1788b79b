// SPDX-License-Identifier: Apache-2.0
// Controls of a playback: pause, position and rate.

import { useState } from "preact/hooks";
import { clockTime, dateTime, duration } from "../format.ts";
import { ENDED, PLAYING, type PlaybackState, nanoseconds, seconds } from "../messages.ts";
import { useApp, useSecond } from "./hooks.ts";

const RATES = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100];

export function Playback({ playback }: { playback: PlaybackState }) {
  const { send, state } = useApp();
  const [dragged, setDragged] = useState<number | undefined>();
  useSecond();
  const start = seconds(playback.start);
  const length = Math.max(seconds(playback.end) - start, 0);
  const isPlaying = playback.status === PLAYING;
  const played = seconds(playback.position) - start;
  const at = dragged ?? Math.min(Math.max(isPlaying ? state.now() - start : played, 0), length);
  const rates = [...new Set([...RATES, playback.rate])].sort((a, b) => a - b);
  const go = (offset: number) => {
    const seek = nanoseconds(playback.start) + BigInt(Math.round(offset * 1e9));
    send({ kind: "play", play: isPlaying, rate: playback.rate, seek });
    setDragged(undefined);
  };
  const status = playback.status === ENDED ? "ended" : isPlaying ? "playing" : "paused";
  return (
    <section class="playback" aria-label="Playback of a recording">
      <button type="button" class="play" aria-label={isPlaying ? "Pause" : "Play"}
        onClick={() => {
          const seek = playback.status === ENDED ? nanoseconds(playback.start) : undefined;
          send({ kind: "play", play: !isPlaying, rate: playback.rate, seek });
        }}>
        <svg viewBox="0 0 24 24" width="26" height="26" aria-hidden="true">
          {isPlaying ? <path d="M6 4h4v16H6zM14 4h4v16h-4z" /> : <path d="M7 4l13 8-13 8z" />}
        </svg>
      </button>
      <div class="bag">
        <strong>{playback.bag.split("/").at(-1)}</strong>
        <small>{status}, {dateTime(start + at)}</small>
      </div>
      <input type="range" min={0} max={length} step="any" value={at}
        aria-label="Position in the recording"
        aria-valuetext={`${duration(at)} of ${duration(length)}, ${clockTime(start + at)}`}
        onInput={(event) => setDragged(Number(event.currentTarget.value))}
        onChange={(event) => go(Number(event.currentTarget.value))} />
      <span class="position">{duration(at)} / {duration(length)}</span>
      <label class="rate">
        <span class="unseen">Speed</span>
        <select value={playback.rate}
          onChange={(event) =>
            send({ kind: "play", play: isPlaying, rate: Number(event.currentTarget.value) })}>
          {rates.map((rate) => <option key={rate} value={rate}>{rate} ×</option>)}
        </select>
      </label>
    </section>
  );
}
