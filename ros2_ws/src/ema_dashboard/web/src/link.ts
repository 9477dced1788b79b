// SPDX-License-Identifier: Apache-2.0
// The connection to the dashboard node by Foxglove's protocol, restored after each interruption.

import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { type Channel, FoxgloveClient, type IWebSocket } from "@foxglove/ws-protocol";
import type { Connection } from "./protocol.ts";

const SUBPROTOCOL = "foxglove.sdk.v1";
const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 5000;
const PLAYBACK_CONTROL_REQUEST = 3; // opcode of the request

const MOST_DETAIL = 300;
// Meaning of a status with which the node refuses a request; its response has the details.
const CHECKS: Record<number, string> = {
  401: "access denied (token)",
  403: "access denied (address of this page)",
};

interface Subscribed {
  id?: number;
  channel: Channel;
  reader: MessageReader<unknown>;
}

export interface Listener {
  /** Whether to subscribe to a topic. */
  wants(topic: string): boolean;
  /** Called with each message; decode() should be called only for messages that are shown. */
  message(topic: string, data: DataView, decode: () => unknown): void;
  channels(topics: string[]): void;
  connection(connection: Connection): void;
  session(): void;
}

export class Link {
  #url: string;
  #listener: Listener;
  #socket?: WebSocket;
  #client?: FoxgloveClient;
  #channels = new Map<number, Subscribed>();
  #subscriptions = new Map<number, Subscribed>();
  #session?: string;
  #attempt = 0;
  #timer?: ReturnType<typeof setTimeout>;
  #readers = new Map<string, MessageReader<unknown>>();
  #requests = 0;

  constructor(url: string, listener: Listener) {
    this.#url = url;
    this.#listener = listener;
  }

  open(): void {
    clearTimeout(this.#timer);
    if (this.#socket && this.#socket.readyState <= WebSocket.OPEN) return;
    this.#attempt += 1;
    const socket = new WebSocket(this.#url, [SUBPROTOCOL]);
    const client = new FoxgloveClient({ ws: socket as unknown as IWebSocket });
    let wasOpen = false;
    this.#socket = socket;
    this.#client = client;
    client.on("serverInfo", (info) => {
      wasOpen = true;
      this.#attempt = 0;
      if (this.#session !== undefined && info.sessionId !== this.#session) this.#listener.session();
      this.#session = info.sessionId ?? "";
      this.#listener.connection({ state: "open" });
    });
    client.on("advertise", (channels) => this.#advertised(channels));
    client.on("unadvertise", (ids) => {
      for (const id of ids) {
        const gone = this.#channels.get(id);
        if (gone?.id !== undefined) this.#subscriptions.delete(gone.id);
        this.#channels.delete(id);
      }
      this.#tellChannels();
    });
    client.on("message", ({ subscriptionId, data }) => {
      const subscribed = this.#subscriptions.get(subscriptionId);
      if (!subscribed) return;
      const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
      this.#listener.message(subscribed.channel.topic, view, () => subscribed.reader.readMessage(view));
    });
    // Ignore messages of kinds that this version of the client does not support.
    client.on("error", () => undefined);
    client.on("close", (event) => {
      this.#channels.clear();
      this.#subscriptions.clear();
      void this.#closed(event as CloseEvent, wasOpen);
    });
  }

  /** Subscribe to the topics that the listener wants, and unsubscribe from the others. */
  update(): void {
    for (const subscribed of this.#channels.values()) {
      const isWanted = this.#listener.wants(subscribed.channel.topic);
      if (isWanted && subscribed.id === undefined) {
        subscribed.id = this.#client!.subscribe(subscribed.channel.id);
        this.#subscriptions.set(subscribed.id, subscribed);
      } else if (!isWanted && subscribed.id !== undefined) {
        this.#client!.unsubscribe(subscribed.id);
        this.#subscriptions.delete(subscribed.id);
        subscribed.id = undefined;
      }
    }
  }

  /** Play or pause at a rate, and seek to a log time [ns] if specified. */
  control(play: boolean, rate: number, seek?: bigint): void {
    if (this.#socket?.readyState !== WebSocket.OPEN) return;
    const id = new TextEncoder().encode(`page-${++this.#requests}`);
    const data = new DataView(new ArrayBuffer(19 + id.length));
    data.setUint8(0, PLAYBACK_CONTROL_REQUEST);
    data.setUint8(1, play ? 0 : 1);
    data.setFloat32(2, rate, true);
    data.setUint8(6, seek === undefined ? 0 : 1);
    data.setBigUint64(7, seek ?? 0n, true);
    data.setUint32(15, id.length, true);
    new Uint8Array(data.buffer, 19).set(id);
    this.#socket.send(data.buffer);
  }

  #advertised(channels: Channel[]): void {
    for (const channel of channels) {
      if (channel.encoding !== "cdr" || channel.schemaEncoding !== "ros2msg") continue;
      let reader = this.#readers.get(channel.schema);
      if (!reader) {
        reader = new MessageReader(parse(channel.schema, { ros2: true }));
        this.#readers.set(channel.schema, reader);
      }
      this.#channels.set(channel.id, { channel, reader });
    }
    this.#tellChannels();
    this.update();
  }

  #tellChannels(): void {
    this.#listener.channels([...this.#channels.values()].map((subscribed) => subscribed.channel.topic));
  }

  async #closed(event: CloseEvent, wasOpen: boolean): Promise<void> {
    const wait = Math.min(FIRST_WAIT_MS * 2 ** Math.max(this.#attempt - 1, 0), LONGEST_WAIT_MS);
    const retryAt = Date.now() + wait;
    this.#timer = setTimeout(() => this.open(), wait);
    const reason = await refusal(event, wasOpen);
    // The page may have reconnected while the reason was requested.
    if (this.#socket && this.#socket.readyState <= WebSocket.OPEN) return;
    if (reason) this.#listener.connection({ state: "refused", reason, retryAt });
    else this.#listener.connection({ state: "closed", reason: event.reason, retryAt });
  }
}

/** Reason why the server refuses this page; "" if it cannot be reached. */
async function refusal(event: CloseEvent, wasOpen: boolean): Promise<string> {
  if (event.code === 1008 || event.code === 1013) {
    return event.reason || "the server closed the connection";
  }
  if (wasOpen) return "";
  // Browsers do not report the response to a failed upgrade. A POST passes the same checks, because it
  // has the same origin in its header, and is never served.
  try {
    const answer = await fetch(".", { method: "POST", cache: "no-store" });
    if (answer.status === 405) {
      return "the page is served, but not its data: the server has reached its limit of clients";
    }
    if (answer.status === 503) return "the server has reached its limit of clients";
    const check = CHECKS[answer.status];
    const detail = check ? (await answer.text()).trim().slice(0, MOST_DETAIL) : "";
    if (detail) return `${check}: ${detail}`;
    return `the server responded with status ${answer.status}`;
  } catch {
    return "";
  }
}
