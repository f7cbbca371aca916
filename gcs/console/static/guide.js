// A page of text: dark or light as the console.

import { Theme } from "./theme.js";

new Theme();
