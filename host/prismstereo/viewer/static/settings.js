// The camera's settings, built from what it says of itself: names, units, ranges, choices.

const NAMES = {
  exposure_us: 'Exposure',
  gain: 'Gain',
  rate_hz: 'Frame rate',
  lens_position: 'Lens position',
  region: 'Region',
  matcher: 'Matcher',
  bound: 'Largest coding error',
  stream: 'Disparity',
  zones: 'Obstacle zones',
  confidence: 'Confidence',
};
const OURS = new Set(['preview', 'raw', 'reasons']); // switched by what the page shows

export class Settings {
  /** `change(name, value)` asks the camera and gives what is in force now, or throws. */
  constructor(form, { change, note }) {
    Object.assign(this, { form, change, note });
    form.addEventListener('submit', (event) => event.preventDefault());
  }

  build(details) {
    this.form.replaceChildren();
    const rules = (details.settings ?? []).filter((rule) => !OURS.has(rule.name));
    for (const rule of rules) this.form.append(this.row(rule, details.values[rule.name]));
    if (!rules.length) this.form.append(text('p', 'A recording has no settings.', 'quiet'));
  }

  row(rule, value) {
    const row = document.createElement('div');
    row.className = 'setting';
    const label = text('label', NAMES[rule.name] ?? rule.name.replaceAll('_', ' '));
    const input = control(rule, value);
    input.id = label.htmlFor = `set-${rule.name}`;
    input.disabled ||= Boolean(rule.unavailable);
    const about = [rule.about, rule.unavailable, range(rule)].filter(Boolean).join('; ');
    if (about) {
      row.title = about;
      input.setAttribute('aria-description', about);
    }
    row.append(label, input, text('span', rule.unit === '1/16 px' ? '1/16 px' : (rule.unit ?? ''), 'unit'));
    let auto = null;
    if (rule.automatic && !rule.unavailable && rule.kind !== 'choice') {
      auto = document.createElement('input');
      Object.assign(auto, { type: 'checkbox', checked: value === 'auto' });
      auto.setAttribute('aria-label', `${label.textContent}: automatic`);
      const frame = text('label', 'auto', 'auto');
      frame.prepend(auto);
      row.append(frame);
      input.disabled = value === 'auto';
      auto.addEventListener('change', () => {
        input.disabled = auto.checked;
        if (auto.checked) this.send(rule, 'auto', row, value);
        else input.focus();
      });
    }
    input.addEventListener('change', () => this.send(rule, read(rule, input), row, value));
    return row;
  }

  async send(rule, wished, row, before) {
    try {
      const { value } = await this.change(rule.name, wished);
      row.replaceWith(this.row(rule, value));
    } catch (error) {
      this.note(error.message, true);
      row.replaceWith(this.row(rule, before));
    }
  }
}

function control(rule, value) {
  if (rule.kind === 'choice') {
    const select = document.createElement('select');
    for (const choice of rule.automatic ? ['auto', ...rule.choices] : rule.choices) {
      const option = text('option', `${choice}`);
      option.value = JSON.stringify(choice);
      option.selected = choice === value;
      select.append(option);
    }
    return select;
  }
  const input = document.createElement('input');
  if (rule.kind === 'switch') Object.assign(input, { type: 'checkbox', checked: value === true });
  else if (rule.kind === 'region') Object.assign(input, { type: 'text', value: value === 'auto' ? '' : value.join(', '), placeholder: 'x, y, width, height' });
  else {
    Object.assign(input, { type: 'number', min: rule.least, max: rule.most, step: rule.kind === 'whole' ? 1 : 'any' });
    input.value = value === 'auto' ? '' : value;
    input.inputMode = 'decimal';
  }
  return input;
}

function read(rule, input) {
  if (rule.kind === 'choice') return JSON.parse(input.value);
  if (rule.kind === 'switch') return input.checked;
  if (rule.kind === 'region') return input.value.split(/[ ,]+/).filter(Boolean).map(Number);
  return Number(input.value);
}

function range(rule) {
  if (rule.kind !== 'number' && rule.kind !== 'whole') return '';
  if (rule.unavailable) return '';
  return `${rule.least} to ${rule.most} ${rule.unit ?? ''}`.trim();
}

export function text(kind, words, className = '') {
  const element = document.createElement(kind);
  element.textContent = words;
  if (className) element.className = className;
  return element;
}
