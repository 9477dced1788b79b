// SPDX-License-Identifier: Apache-2.0
// A web server for the tests: the shipped page and the WebSocket of a backend, on one port.
// It can disconnect clients, refuse requests and leave them unanswered.

import { readFile } from "node:fs/promises";
import { createServer, request as forward } from "node:http";
import { connect } from "node:net";
import path from "node:path";
import { fileURLToPath } from "node:url";

const page = fileURLToPath(new URL("../../ema_dashboard/page/", import.meta.url));
const TYPES = {
  ".html": "text/html; charset=utf-8",
  ".js": "text/javascript; charset=utf-8",
  ".css": "text/css; charset=utf-8",
  ".svg": "image/svg+xml",
};
// The strictest policy with which the page works; the dashboard node's policy must not be stricter.
const POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; " +
  "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'";

export class Origin {
  backend = 0; // port of the backend
  refusalStatus = 0; // HTTP status with which all requests are refused; 0: none is refused
  refusalReason = ""; // body of a refusal
  isDown = false; // whether all requests are closed without an answer
  fleet = { archive: null }; // summary of an archive, or the reason why it is missing
  isHanging = false; // whether WebSocket requests stay open without an answer
  #server;
  #sockets = new Set();

  async listen() {
    this.#server = createServer((request, response) => void this.#answer(request, response));
    this.#server.on("upgrade", (request, socket, head) => {
      socket.on("error", () => undefined);
      if (this.isHanging) return;
      if (this.isDown) {
        socket.destroy();
        return;
      }
      if (this.refusalStatus || !this.backend) {
        socket.end(`HTTP/1.1 ${this.refusalStatus || 502} No\r\nConnection: close\r\n\r\n`);
        return;
      }
      const upstream = connect(this.backend, "127.0.0.1");
      upstream.on("error", () => socket.destroy());
      socket.on("close", () => upstream.destroy());
      upstream.on("close", () => socket.destroy());
      this.#sockets.add(socket);
      socket.on("close", () => this.#sockets.delete(socket));
      const lines = [`${request.method} ${request.url} HTTP/1.1`];
      for (let i = 0; i < request.rawHeaders.length; i += 2) {
        lines.push(`${request.rawHeaders[i]}: ${request.rawHeaders[i + 1]}`);
      }
      upstream.write(`${lines.join("\r\n")}\r\n\r\n`);
      upstream.write(head);
      socket.pipe(upstream).pipe(socket);
    });
    await new Promise((resolve) => this.#server.listen(0, "127.0.0.1", resolve));
    return `http://127.0.0.1:${this.#server.address().port}/`;
  }

  /** Close the WebSocket connections of all pages. */
  disconnect() {
    for (const socket of this.#sockets) socket.destroy();
  }

  close() {
    this.disconnect();
    this.#server.closeAllConnections();
    this.#server.close();
  }

  async #answer(request, response) {
    if (this.isDown) {
      request.socket.destroy();
      return;
    }
    if (request.method === "POST") {
      if (this.refusalStatus || request.url === "/") {
        response.writeHead(this.refusalStatus || 405).end(this.refusalStatus ? this.refusalReason : "");
        return;
      }
      const { method, url: path, headers } = request;
      const upstream = forward({ port: this.backend, host: "127.0.0.1", method, path, headers }, (answer) => {
        response.writeHead(answer.statusCode, answer.headers);
        answer.pipe(response);
      });
      upstream.on("error", () => request.socket.destroy());
      request.pipe(upstream);
      return;
    }
    if (request.url.startsWith("/fleet.json")) {
      const isMissing = typeof this.fleet === "string";
      response.writeHead(isMissing ? 503 : 200, { "Content-Type": "application/json" });
      response.end(JSON.stringify(isMissing ? { reason: this.fleet } : this.fleet));
      return;
    }
    const name = new URL(request.url, "http://local").pathname.slice(1) || "index.html";
    try {
      const content = await readFile(path.join(page, path.basename(name)));
      response.writeHead(200, {
        "Content-Type": TYPES[path.extname(name)] ?? "text/plain; charset=utf-8",
        "Content-Security-Policy": POLICY,
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-cache",
      });
      response.end(request.method === "HEAD" ? undefined : content);
    } catch {
      response.writeHead(404).end();
    }
  }
}
