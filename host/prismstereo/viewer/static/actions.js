// Buttons that ask for something that takes a while.

import { note } from './panels.js';

export const busy = new Set();

/** Let a button do something that takes a while; its complaint is shown. */
export function action(id, act, waiting) {
  const button = document.getElementById(id);
  button.addEventListener('click', async () => {
    const words = button.textContent;
    busy.add(id);
    button.disabled = true;
    if (waiting) button.textContent = waiting;
    try {
      await act();
    } catch (error) {
      note(error.message, true);
    } finally {
      busy.delete(id);
      button.disabled = false;
      if (waiting) button.textContent = words;
    }
  });
}
