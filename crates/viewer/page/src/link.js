// The WebSocket to the server: one binary message = length of the JSON (u32, little-endian), the JSON, grey levels.

const AGAIN_MS = 1000;
const text = new TextDecoder();

/** Calls `onNews(json, pixels)` for every message, `onLost()` when the connection is gone; tries again by itself. Returns `send`. */
export function connect(onNews, onLost) {
  let socket;
  const open = () => {
    socket = new WebSocket(`ws://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => {
      const length = new DataView(data).getUint32(0, true);
      onNews(JSON.parse(text.decode(new Uint8Array(data, 4, length))), new Uint8Array(data, 4 + length));
    };
    socket.onclose = ({ reason }) => {
      onLost(reason);
      setTimeout(open, AGAIN_MS);
    };
  };
  open();
  return (ask) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(ask));
  };
}
