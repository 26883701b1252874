/PROG  HALF_TAUGHT
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
PROG_SIZE	= 1204;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:J P[1] 20% FINE    ;
   2:J P[2] 20% FINE    ;
   3:J P[3] 20% FINE    ;
   4:J P[1] 20% FINE    ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
};
P[2]{
   GP1:
	UF : 2, UT : 3,	
	J1= ******** deg,	J2= ******** deg,	J3= ******** deg,
	J4= ******** deg,	J5= ******** deg,	J6= ******** deg
};
P[3]{
   GP1:
	UF : 2, UT : 3,	
	J1=    20.588 deg,	J2=    27.011 deg,	J3=   -11.918 deg,
	J4=     3.963 deg,	J5=    70.919 deg,	J6=     9.268 deg
};
P[4]{
   GP1:
	UF : F, UT : F,		CONFIG : 'N U T, 0, 0, 0',
	X = ********  mm,	Y = ********  mm,	Z = ********  mm,
	W = ******** deg,	P = ******** deg,	R = ******** deg
};
/END
