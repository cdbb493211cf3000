// Elements from data, and a page that follows them without losing focus or what is being typed.

const SVG = "http://www.w3.org/2000/svg";
const DRAWN = new Set(["svg", "g", "path", "circle", "rect", "text", "polygon", "line", "title"]);

/** An element with attributes (null and false leave one out) and children (null is no child). */
export function h(name, attributes = {}, ...children) {
  const element = DRAWN.has(name)
    ? document.createElementNS(SVG, name)
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(key, value === true ? "" : String(value));
    }
  }
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) element.append(child);
  }
  return element;
}

/** Make `old` hold what `wanted` holds: elements of the same kind are kept, with their focus. */
export function morph(old, wanted) {
  const before = [...old.childNodes];
  const after = [...wanted.childNodes];
  after.forEach((node, i) => {
    const met = before[i];
    if (!met) old.append(node);
    else if (!alike(met, node)) met.replaceWith(node);
    else if (met.nodeType === Node.TEXT_NODE) setText(met, node);
    else morphElement(met, node);
  });
  before.slice(after.length).forEach((node) => node.remove());
}

function alike(a, b) {
  return a.nodeName === b.nodeName && a.id === b.id && a.dataset?.key === b.dataset?.key;
}

function setText(met, node) {
  if (met.data !== node.data) met.data = node.data;
}

function morphElement(met, node) {
  for (const { name } of [...met.attributes]) {
    // Whether a list is folded out is the reader's own affair.
    if (!node.hasAttribute(name) && !(met.nodeName === "DETAILS" && name === "open")) {
      met.removeAttribute(name);
    }
  }
  for (const { name, value } of node.attributes) {
    if (met.getAttribute(name) !== value) met.setAttribute(name, value);
  }
  morph(met, node);
  setControl(met, node);
}

/** What a field shows is no attribute; a field that is being typed in is left alone. */
function setControl(met, node) {
  if (met === document.activeElement && met.matches("input:not([type=checkbox], [type=radio])")) {
    return;
  }
  if (met.matches("input[type=checkbox], input[type=radio]")) met.checked = node.checked;
  else if (met.matches("input:not([type=file]), select")) {
    if (met.value !== node.value) met.value = node.value;
  }
}

/** Give a file to the person at the screen. */
export function download(name, content, kind = "application/octet-stream") {
  const address = URL.createObjectURL(new Blob([content], { type: kind }));
  save(name, address);
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/** The same for what has an address of its own. */
export function save(name, address) {
  h("a", { href: address, download: name }).click();
}
