// SPDX-License-Identifier: Apache-2.0
// A web server for the tests: the shipped page and the WebSocket of a backend, on one port.
// It can disconnect, refuse requests, and count what the page loads.

import { readFile } from "node:fs/promises";
import { createServer, request as ask } from "node:http";
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
// The strictest policy with which the page works; that of the dashboard node must not be stricter.
const POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; " +
  "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'";

export class Origin {
  backend = 0; // port of the backend
  refuses = 0; // HTTP status with which all requests are refused
  reason = ""; // reason of the refusal
  isDown = false; // whether all requests fail
  fleet = { archive: null }; // summary of an archive, or the reason why it is missing
  holds = false; // whether connections stay open without an answer
  #server;
  #sockets = new Set();

  async listen() {
    this.#server = createServer((request, response) => void this.#answer(request, response));
    this.#server.on("upgrade", (request, socket, head) => {
      socket.on("error", () => undefined);
      if (this.holds) return;
      if (this.isDown) {
        socket.destroy();
        return;
      }
      if (this.refuses || !this.backend) {
        socket.end(`HTTP/1.1 ${this.refuses || 502} No\r\nConnection: close\r\n\r\n`);
        return;
      }
      const behind = connect(this.backend, "127.0.0.1");
      behind.on("error", () => socket.destroy());
      socket.on("close", () => behind.destroy());
      behind.on("close", () => socket.destroy());
      this.#sockets.add(socket);
      socket.on("close", () => this.#sockets.delete(socket));
      const lines = [`${request.method} ${request.url} HTTP/1.1`];
      for (let i = 0; i < request.rawHeaders.length; i += 2) {
        lines.push(`${request.rawHeaders[i]}: ${request.rawHeaders[i + 1]}`);
      }
      behind.write(`${lines.join("\r\n")}\r\n\r\n`);
      behind.write(head);
      socket.pipe(behind).pipe(socket);
    });
    await new Promise((resolve) => this.#server.listen(0, "127.0.0.1", resolve));
    return `http://127.0.0.1:${this.#server.address().port}/`;
  }

  /** Close all connections of pages. */
  cut() {
    for (const socket of this.#sockets) socket.destroy();
  }

  close() {
    this.cut();
    this.#server.closeAllConnections();
    this.#server.close();
  }

  async #answer(request, response) {
    if (this.isDown) {
      request.socket.destroy();
      return;
    }
    if (request.method === "POST") {
      if (this.refuses || request.url === "/") {
        response.writeHead(this.refuses || 405).end(this.refuses ? this.reason : "");
        return;
      }
      const { method, url: path, headers } = request;
      const behind = ask({ port: this.backend, host: "127.0.0.1", method, path, headers }, (answer) => {
        response.writeHead(answer.statusCode, answer.headers);
        answer.pipe(response);
      });
      behind.on("error", () => request.socket.destroy());
      request.pipe(behind);
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
