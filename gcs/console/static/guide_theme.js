// Theme of the page of alarms: dark or light as the console.

import { Theme } from "./theme.js";

new Theme();
