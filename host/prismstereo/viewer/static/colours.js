// Colours for depth: near is bright. Cividis and viridis read the same to colour-blind eyes; turbo shows finer steps.

const STOPS = {
  viridis:
    '440154 471164 481f70 472d7b 443983 404688 3b528b 365d8d 31688e 2c728e 287c8e 24868e 21918c ' +
    '1f9a8a 20a486 27ad81 35b779 48c16e 5cc863 75d054 8ed645 aadc32 c8e020 e2e418 fde725',
  cividis:
    '00224e 002a61 003170 1a386f 2a3f6d 38476c 434e6c 4d556c 575d6d 61656f 6a6c71 737475 7d7c78 ' +
    '868379 918b78 9a9376 a59c74 b0a571 bbad6d c6b667 d1bf61 ddc858 e9d34e f5dc41 fee838',
  turbo:
    '30123b 3c3286 434eba 466be3 4685fa 3ba0fd 28bceb 1ad2d2 1ae4b6 32f298 55fa76 80ff53 a4fc3c ' +
    'bef434 d9e436 ecd13a faba39 fe9e2f fb8122 f26014 e5470b d23105 b91e02 9e1001 7a0403',
};

export const MAPS = Object.keys(STOPS);
const FIRST = 0.1; // the darkest tenth would be lost on a dark page
const tables = new Map();

/** The 256 colours of a map, RGBA bytes, far first. */
export function table(name) {
  if (!tables.has(name)) {
    const stops = STOPS[name].split(' ').map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));
    const bytes = new Uint8Array(256 * 4);
    for (let i = 0; i < 256; i++) {
      const place = (FIRST + (1 - FIRST) * (i / 255)) * (stops.length - 1);
      const below = Math.min(Math.floor(place), stops.length - 2);
      const share = place - below;
      for (let c = 0; c < 3; c++) {
        bytes[4 * i + c] = Math.round(stops[below][c] * (1 - share) + stops[below + 1][c] * share);
      }
      bytes[4 * i + 3] = 255;
    }
    tables.set(name, bytes);
  }
  return tables.get(name);
}

/** The same as 32-bit words for ImageData. */
export function words(name) {
  return new Uint32Array(table(name).buffer);
}

// Reasons by number, as the camera numbers them: words, and a colour that is not in the maps.
export const REASONS = [
  ['matched', '#000000'],
  ['outside of the other view', '#39424e'],
  ['in the seam of the two views', '#5a4a63'],
  ['too little light comes there', '#4a4436'],
  ['nearer than the range', '#c2554d'],
  ['farther than the range', '#4d7fc2'],
  ['hidden from the other view', '#8e5bb5'],
  ['too little texture', '#6f7b88'],
  ['ambiguous: it repeats', '#b58a3c'],
  ['overexposed', '#d9d4c4'],
  ['too dark', '#2a2f36'],
  ['taken away by a filter', '#5f8f7a'],
  ['lost on the line', '#b5487f'],
  ['no match found', '#4c535c'],
];
