#!/usr/bin/env bash
# The npm client of the Model Context Protocol (@modelcontextprotocol/sdk 1.32.2): a call is given up after its time
# (60 s by default) even while the server reports progress and the client listens to it.
#
# Only resetTimeoutOnProgress makes reports count, and it is off by default. The server is not at fault and goes on
# working.
#
# Seen: a tool of 3 s that reports five times a second, called with a limit of 1.5 s, first as it is, then with the
# option.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init -y >/dev/null
npm install --silent @modelcontextprotocol/sdk@1.32.2
cat >client.mjs <<'JS'
import { Client } from "@modelcontextprotocol/sdk/client/index.js";
import { InMemoryTransport } from "@modelcontextprotocol/sdk/inMemory.js";
import { McpServer } from "@modelcontextprotocol/sdk/server/mcp.js";

const server = new McpServer({ name: "slow", version: "1" });
server.tool("slow", async ({ _meta, sendNotification }) => {
  for (let k = 1; k <= 15; k++) {
    await new Promise((go) => setTimeout(go, 200));
    const params = { progressToken: _meta.progressToken, progress: k, total: 15 };
    await sendNotification({ method: "notifications/progress", params });
  }
  return { content: [{ type: "text", text: "done" }] };
});
const [one, other] = InMemoryTransport.createLinkedPair();
const client = new Client({ name: "client", version: "1" });
await Promise.all([server.connect(one), client.connect(other)]);
for (const more of [{}, { resetTimeoutOnProgress: true }]) {
  let heard = 0;
  const options = { timeout: 1500, onprogress: () => heard++, ...more };
  const answer = await client.callTool({ name: "slow" }, undefined, options).then((r) => r.content[0].text, (e) => e.message);
  console.log(JSON.stringify(more), answer, heard > 2 ? "progress was heard" : "");
}
await client.close();
JS
node client.mjs >seen 2>/dev/null
diff - seen <<'SEEN'
{} MCP error -32001: Request timed out progress was heard
{"resetTimeoutOnProgress":true} done progress was heard
SEEN
echo "as described"
