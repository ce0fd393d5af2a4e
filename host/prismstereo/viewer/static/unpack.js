// Messages of the server, unpacked with what every browser has.

export const KIND = { disparity: 1, left: 2, raw: 3, pair: 4, reasons: 5 };
const FORM = 1;

/** Split a message into kind, head and body. */
export function parse(buffer) {
  const view = new DataView(buffer);
  if (view.getUint8(1) !== FORM) throw new Error('this page is older than its server: reload it');
  const length = view.getUint16(2, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { kind: view.getUint8(0), head, body: new Uint8Array(buffer, 4 + length) };
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Disparities in sixteenths of a pixel, 0 where unmatched: differences along each row, folded, low bytes first. */
export async function steps(head, body) {
  const { width, height } = head;
  const bytes = await inflate(body);
  const count = width * height;
  if (bytes.length !== 2 * count) throw new Error(`a map of ${bytes.length} bytes, ${2 * count} are due`);
  const out = new Uint16Array(count);
  for (let row = 0, i = 0; row < height; row++) {
    let value = 0;
    for (let end = i + width; i < end; i++) {
      const folded = bytes[i] | (bytes[i + count] << 8);
      value = (value + ((folded >>> 1) ^ -(folded & 1))) & 0xffff;
      out[i] = value;
    }
  }
  return out;
}

export const plane = (body) => inflate(body);

export const picture = (body) => createImageBitmap(new Blob([body], { type: 'image/jpeg' }));
